"""The `roller` command."""

from __future__ import annotations

import argparse
import importlib
import signal
import sys
from collections.abc import Sequence

from roller_bringup.ending import Ended, ending_in_order
from roller_core.errors import RollerError
from roller_core.memory import keep_freed_memory
from roller_core.opencv import one_opencv_thread

#: Name of a subcommand's module and its line of help; modules are loaded when they are used.
_COMMANDS = {
    "simulate": ("roller_driver.virtual.command", "simulate a scan, written as a bag"),
    "replay": ("roller_bringup.commands.replay", "process a recording offline"),
    "up": ("roller_bringup.commands.up", "run a launch file"),
    "demo": ("roller_bringup.commands.demo", "roll the virtual cell over a plate, live"),
    "record": ("roller_bringup.commands.record", "record the running graph"),
    "calibrate": ("roller_bringup.commands.calibrate", "calibrate the cell from recordings"),
    "info": ("roller_bringup.commands.info", "tell what a recording holds"),
    "doctor": (
        "roller_bringup.commands.doctor",
        "check libraries, ROS, camera, robot, clock, disk",
    ),
    "bench": ("roller_bringup.commands.bench", "measure speed against error"),
    "evaluate": (
        "roller_bringup.commands.evaluate",
        "repeat the paper's experiments on the virtual cell",
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand.

    Returns
    -------
    int
        0 if all was well; 1 after a fault, told in one line; 2 for wrong usage; 128 and a
        signal's number when that ended it (130 after Ctrl-C).
    """
    words = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(
        prog="roller", description="Surface inspection with an event-camera tactile roller."
    )
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    chosen = next((w for w in words if not w.startswith("-")), None)
    for name, (module, line) in _COMMANDS.items():
        if name == chosen:
            command = importlib.import_module(module)
            command.add_parser(subparsers)
            words = getattr(command, "rewritten", list)(words)
        else:
            subparsers.add_parser(name, help=line)
    args = parser.parse_args(words)
    keep_freed_memory()
    one_opencv_thread()
    try:
        with ending_in_order():
            return int(args.run(args))
    except RollerError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print("interrupted", file=sys.stderr)
        return 128 + (interrupt.number if isinstance(interrupt, Ended) else signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main())
