"""`roller doctor`: check libraries, ROS, camera, robot, clock, disk."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_core.command_help import add_examples
from roller_core.option_types import add_output


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `doctor` to the command's parser."""
    parser = subparsers.add_parser(
        "doctor",
        help="check libraries, ROS, camera, robot, clock, disk",
        description="Check whether this machine is ready: libraries, ROS 2 and DDS, USB, camera, "
        "robot, disk, processor, clock; with --cell how far the cell is "
        "calibrated. A missing camera or robot is a warning unless it is asked "
        "for. The exit code is 0 when nothing is a fault.",
    )
    parser.add_argument(
        "--camera",
        nargs="?",
        const="",
        metavar="SERIAL",
        help="the event camera must be there (that with this serial number)",
    )
    parser.add_argument(
        "--robot-ip", default="", metavar="IP", help="the robot at this address must be there"
    )
    add_output(parser, "where recordings are to go (recording)", default=Path("recording"))
    parser.add_argument(
        "--backend",
        default="",
        metavar="MODULE:FUNCTION",
        help="USB library, as the parameter of event_camera; else the system's libusb",
    )
    parser.add_argument(
        "--cell",
        type=Path,
        nargs="?",
        const=Path(),
        metavar="FILE",
        help="go through the cell's calibration too: its parameter file, if there is one yet",
    )
    parser.add_argument(
        "--hand-eye", type=Path, metavar="FILE", help="with --cell: file of the camera's place"
    )
    parser.add_argument(
        "--camera-info", type=Path, metavar="FILE", help="with --cell: the camera's calibration"
    )
    parser.add_argument(
        "--golden", type=Path, metavar="DIR", help="with --cell: what `inspect teach` wrote"
    )
    parser.add_argument(
        "--certificate", type=Path, metavar="DIR", help="with --cell: of `calibrate acceptance`"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_examples(
        parser,
        "doctor",
        "doctor --camera --robot-ip 192.168.0.10",
        "doctor --cell cell.yaml --hand-eye hand_eye.yaml --camera-info camera.yaml",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check and print; 1 where something is a fault."""
    from rich.console import Console

    from roller_bringup.doctor.commissioning import CellFiles, next_step
    from roller_bringup.doctor.examination import Request, examine
    from roller_bringup.doctor.result import as_json, as_table

    of_cell = (args.hand_eye, args.camera_info, args.golden, args.certificate)
    if any(of_cell) and args.cell is None:
        args.cell = Path()
    cell = None
    if args.cell is not None:
        params = args.cell if args.cell != Path() else None
        cell = CellFiles(params, *of_cell)
    request = Request(args.camera, args.robot_ip, args.output, args.backend, cell)
    with Console(stderr=True).status("looking") as status:
        results = list(examine(request, lambda what: status.update(f"looking at {what}")))
    if args.json:
        print(as_json(results))
    else:
        console = Console()
        # Not a terminal but a file or a pipe, which has no width.
        Console(width=None if console.is_terminal else 140).print(as_table(results))
        if cell is not None:
            print(next_step(results) or "all steps of docs/commissioning.md are done")
    return 1 if any(r.level == "fault" for r in results) else 0
