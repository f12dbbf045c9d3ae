"""The `roller` command."""

from __future__ import annotations

import argparse
import ast
import importlib
import importlib.util
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path

from roller_core.errors import RollerError
from roller_core.memory import keep_freed_memory
from roller_core.opencv import one_opencv_thread
from roller_core.signals import Terminated, terminate_in_order

#: Packages name their subcommands in this group of entry points.
GROUP = "roller.commands"


def find_commands() -> dict[str, str]:
    """Modules of the subcommands by name, as the installed packages name them."""
    return {point.name: point.value for point in sorted(entry_points(group=GROUP))}


def _summary(module: str) -> str:
    """What a subcommand does, from the first line of its module, which isn't loaded for it."""
    found = importlib.util.find_spec(module)
    if found is None or found.origin is None:
        return ""
    text = ast.get_docstring(ast.parse(Path(found.origin).read_text())) or ""
    return text.partition("\n")[0].rpartition("`: ")[2].rstrip(".")


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
    commands = find_commands()
    if chosen in commands:
        command = importlib.import_module(commands[chosen])
        command.add_parser(subparsers)
        words = getattr(command, "rewritten", list)(words)
    else:
        for name, module in commands.items():
            subparsers.add_parser(name, help=_summary(module))
    args = parser.parse_args(words)
    keep_freed_memory()
    one_opencv_thread()
    try:
        with terminate_in_order():
            return int(args.run(args))
    except RollerError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print("interrupted", file=sys.stderr)
        return 128 + (interrupt.number if isinstance(interrupt, Terminated) else signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main())
