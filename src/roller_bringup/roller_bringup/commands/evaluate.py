"""`roller evaluate`: experiments with known truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_core.errors import SettingsError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `evaluate` to the command's parser, with a subcommand for each experiment."""
    parser = subparsers.add_parser(
        "evaluate",
        help="run an experiment with known truth",
        description="Run an experiment on simulated scans and compare the results with the truth "
        "and with published figures.",
    )
    experiments = parser.add_subparsers(dest="experiment", metavar="EXPERIMENT", required=True)
    _add_braille(experiments)


def _add_braille(experiments: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = experiments.add_parser(
        "braille",
        help="error rates of reading Braille",
        description="Character and word error rates of reading Braille by speed, noise and method, "
        "and with a wrong speed or depth.",
    )
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("evaluation"),
        metavar="DIR",
        help="results go here (default: evaluation)",
    )
    parser.add_argument("--quick", action="store_true", help="a few letters at one speed")
    parser.add_argument("--speeds", type=_speeds, metavar="V,W", help="m/s")
    parser.add_argument("--text", help="text of the plate: a–z, digits, spaces; \\n ends a line")
    parser.add_argument("--seed", type=int, help="seed of all chance (default: 1)")
    parser.set_defaults(run=_run_braille)


def _run_braille(args: argparse.Namespace) -> int:
    from rich.console import Console

    from roller_bringup.evaluation.braille import BrailleOptions, run_braille
    from roller_bringup.evaluation.braille_report import tables
    from roller_bringup.results.tables import show_tables

    given = {
        name: getattr(args, name) for name in ("speeds", "seed") if getattr(args, name) is not None
    }
    if args.text is not None:
        given["text"] = args.text.replace("\\n", "\n")
    speeds = given.get("speeds", (0.3,))
    if not speeds or any(not 0.01 <= v <= 2.0 for v in speeds):
        raise SettingsError("--speeds: 0.01 to 2 m/s, such as 0.1,0.3")
    options = BrailleOptions.short(**given) if args.quick else BrailleOptions(**given)
    with Console(stderr=True).status("evaluate") as status:
        result = run_braille(
            options,
            args.output,
            lambda text, share: status.update(f"evaluate: {share:.0%}, {text}"),
        )
    show_tables(tables(result))
    print(f"files: {args.output}/braille.json, {args.output}/braille.png")
    return 0


def _speeds(text: str) -> tuple[float, ...]:
    return tuple(dict.fromkeys(float(word) for word in text.split(",") if word.strip()))
