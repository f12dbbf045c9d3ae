"""What the commands have in common: their options, and the file that they write."""

from __future__ import annotations

import argparse
import errno
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from roller_core.calibration_file import CalibrationError, write_calibration
from roller_core.errors import UnwritableOutputError
from roller_core.option_types import add_output
from roller_core.output_overlap import refuse_overlap
from roller_inspect.commands.options import add_recording_options


def add_kind(
    kinds: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    run: Callable[[argparse.Namespace], int],
    nodes: str,
    texts: tuple[str, str],
    skin: bool = False,
) -> argparse.ArgumentParser:
    """Add a subcommand that reads recordings and writes a parameter file.

    Parameters
    ----------
    kinds : subparsers
        Of `calibrate`.
    name : str
        The subcommand.
    run : callable
        What it does.
    nodes : str
        The nodes whose parameters count, for the help text.
    texts : tuple of str
        Its line in the list of subcommands, and its description.
    skin : bool
        Whether what is found belongs to a skin.
    """
    parser = kinds.add_parser(name, help=texts[0], description=texts[1])
    add_output(parser, "ROS 2 parameter file to write", "FILE")
    if skin:
        parser.add_argument(
            "--skin", default="", metavar="NAME", help="name of the skin, for the file"
        )
    add_recording_options(parser, nodes)

    def checked(args: argparse.Namespace) -> int:
        read = (v for option, v in vars(args).items() if option != "output")
        values = (v if isinstance(v, list) else [v] for v in read)
        for source in (v for several in values for v in several):
            if args.output is not None and isinstance(source, Path) and source.is_dir():
                refuse_overlap(source, args.output)
        if args.output is not None and args.output.is_dir():
            raise UnwritableOutputError(f"{args.output}: is a folder; give the name of a file")
        if args.output is not None:
            _check_writable(args.output)
        return run(args)

    parser.set_defaults(run=checked)
    return parser


def _check_writable(file: Path) -> None:
    """Refuse what can't be written, before the work: the first folder above that is there."""
    above = next(folder for folder in file.resolve().parents if os.path.exists(folder))
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        reason = os.strerror(errno.EACCES if above.is_dir() else errno.ENOTDIR)
        raise UnwritableOutputError(f"{file}: can't be written ({reason}); give another --output")


def check_mm(option: str, value: float, least: float = 0.1, most: float = 100.0) -> None:
    """Refuse a gauge's size that none has, NaN too.

    Raises
    ------
    CalibrationError
        If it is out of range.
    """
    if not least <= value <= most:
        raise CalibrationError(f"{option} {value:g}: expected {least:g} to {most:g}")


def write(
    args: argparse.Namespace,
    kind: str,
    lines: Sequence[str],
    parameters: Mapping[str, Mapping[str, Any]],
    record: Mapping[str, Any],
    use: str = "give it to the nodes with params:= or --params",
) -> None:
    """Write what was found, if `--output` says where.

    Parameters
    ----------
    args : Namespace
        With the command's options.
    kind : str
        What was calibrated.
    lines : sequence of str
        For people.
    parameters : mapping
        Values by node.
    record : mapping
        See `calibration_record`.
    use : str
        What to do with the file.

    Raises
    ------
    UnwritableOutputError
        If it can't be written.
    """
    if args.output:
        write_calibration(args.output, kind, lines, parameters, record, args.params)
        print(f"written to {args.output}; {use}")
