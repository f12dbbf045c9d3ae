"""`roller doctor`: check libraries, ROS, camera, robot, clock, disk."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `doctor` to the command's parser."""
    parser = subparsers.add_parser(
        "doctor",
        help="check libraries, ROS, camera, robot, clock, disk",
        description="Check whether this machine is ready: libraries, ROS 2 and DDS, USB, camera, "
        "robot, disk, processor, clock. A missing camera or robot is a warning unless it is asked "
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
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("recording"),
        metavar="DIR",
        help="where recordings are to go (recording)",
    )
    parser.add_argument(
        "--backend",
        default="",
        metavar="MODULE:FUNCTION",
        help="USB library, as the parameter of event_camera; else the system's libusb",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check and print; 1 where something is a fault."""
    from rich.console import Console

    from roller_bringup.doctor.examination import Request, examine
    from roller_bringup.doctor.result import as_json, as_table

    request = Request(args.camera, args.robot_ip, args.output, args.backend)
    with Console(stderr=True).status("looking") as status:
        results = list(examine(request, lambda what: status.update(f"looking at {what}")))
    if args.json:
        print(as_json(results))
    else:
        console = Console()
        # Not a terminal but a file or a pipe, which has no width.
        Console(width=None if console.is_terminal else 140).print(as_table(results))
    return 1 if any(r.level == "fault" for r in results) else 0
