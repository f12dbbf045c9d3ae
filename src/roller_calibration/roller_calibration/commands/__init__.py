"""`roller calibrate`: calibrate the cell from recordings."""

from __future__ import annotations

import argparse

from roller_core.command_help import add_examples

from . import acceptance, edge_drift, flat, hand_eye, intrinsics, scale, sphere, time_offset

__all__ = ["add_parser", "rewritten"]

_TIME_OFFSET = "--time-offset"
_EXAMPLES = {
    "hand-eye": (
        "--grid-recording poses --pitch-mm 6.9 --output hand_eye.yaml",
        "--scan plate --params hand_eye.yaml --output turned.yaml  # how the camera is turned",
    ),
    "time-offset": ("slow fast --output cell.yaml",),
    "flat": ("plate --params cell.yaml --output cell.yaml",),
    "sphere": ("ball_1 ball_2 --radius-mm 10 --params cell.yaml --output cell.yaml",),
    "edge-drift": (
        "--sphere ball --radius-mm 5 --steps stairs --step-mm 0.25 --params cell.yaml "
        "--output cell.yaml",
    ),
    "acceptance": ("--sphere ball --radius-mm 5 --params cell.yaml --output certificate",),
    "scale": ("--readings-mm 1,2,3 --pixels 26.1,52.4,78.3",),
}

#: Those that a cell begins with.
_FIRST = ("flat", "edge-drift")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `calibrate` to the command's parser, with a subcommand for each kind."""
    parser = subparsers.add_parser(
        "calibrate",
        help="calibrate the cell from recordings",
        description="Find parameters of the cell and write them for the nodes. "
        f"`{_TIME_OFFSET}` is another form of `time-offset`.",
    )
    kinds = parser.add_subparsers(dest="kind", metavar="KIND", required=True)
    for module in (intrinsics, hand_eye, time_offset, flat, sphere, edge_drift, scale, acceptance):
        module.add_parser(kinds)
    add_examples(parser, *(f"calibrate {kind} {_EXAMPLES[kind][0]}" for kind in _FIRST))
    for kind, examples in _EXAMPLES.items():
        add_examples(kinds.choices[kind], *(f"calibrate {kind} {words}" for words in examples))


def rewritten(words: list[str]) -> list[str]:
    """The command's words with `--time-offset`, wherever it stands, as the subcommand it means."""
    if _TIME_OFFSET not in words:
        return words
    rest = [word for word in words if word != _TIME_OFFSET]
    at = rest.index("calibrate") + 1
    return [*rest[:at], _TIME_OFFSET.removeprefix("--"), *rest[at:]]
