"""The `roller` command."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from roller_core.errors import TRACEBACK, RollerError, describe_fault_of_ours
from roller_core.signals import run_to_the_end

#: Packages name their subcommands in this group of entry points.
GROUP = "roller.commands"
#: Set by a shell that completes a line.
_COMPLETING = "_ARGCOMPLETE"


def find_commands() -> dict[str, str]:
    """Modules of the subcommands by name, as the installed packages name them."""
    # Imports that take time are made where Ctrl-C is answered in one line.
    from importlib.metadata import entry_points

    return {point.name: point.value for point in sorted(entry_points(group=GROUP))}


def _summary(module: str) -> str:
    """What a subcommand does, from the first line of its module, which isn't loaded for it."""
    import ast

    found = importlib.util.find_spec(module)
    if found is None or found.origin is None:
        return ""
    text = ast.get_docstring(ast.parse(Path(found.origin).read_text())) or ""
    return text.partition("\n")[0].rpartition("`: ")[2].rstrip(".")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand; without words that of this process, which it then ends.

    Returns
    -------
    int
        0 if all was well; 1 after a fault, reported in one line; 2 for wrong usage; 128 and a
        signal's number when that ended it (130 after Ctrl-C).
    """
    if argv is None:
        return run_to_the_end(lambda: main(sys.argv[1:]))
    try:
        # The script `roller` has it wait until here.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                # A file's name may hold bytes that are no text.
                stream.reconfigure(errors="backslashreplace")
        code = _run(list(argv))
        sys.stdout.flush()  # here a reader that has gone is known to be one
        return code
    except KeyboardInterrupt as interrupt:
        print("interrupted", file=sys.stderr)
        return 128 + getattr(interrupt, "number", signal.SIGINT)
    except BrokenPipeError:
        # Whoever read our output has gone; Python would say so once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except Exception as error:
        if os.environ.get(TRACEBACK) == "1":
            raise
        print(f"error: {_describe(error)}", file=sys.stderr)
        return 1


def _run(words: list[str]) -> int:
    """Read the words and do what they say; heavy imports belong to the subcommand."""
    from roller_core.command_help import add_examples
    from roller_core.library_threads import one_thread_a_library
    from roller_core.memory import collect_seldom, keep_freed_memory
    from roller_core.signals import terminate_in_order

    one_thread_a_library()
    keep_freed_memory()
    collect_seldom()

    parser = argparse.ArgumentParser(
        prog="roller", description="Surface inspection with an event-camera tactile roller."
    )
    add_examples(
        parser,
        "simulate defects --coating textured --output scan   # a scan of the virtual cell",
        "inspect scan --output verdict                       # is the part good?",
        "view verdict                                        # the verdict in the browser",
        "COMMAND --help                                      # more of each command",
    )
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    if _COMPLETING in os.environ:
        words = os.environ.get("COMP_LINE", "").split()[1:]
    chosen = next((w for w in words if not w.startswith("-")), None)
    commands = find_commands()
    with terminate_in_order():
        if chosen in commands:
            command = importlib.import_module(commands[chosen])
            command.add_parser(subparsers)
            words = getattr(command, "rewritten", list)(words)
        else:
            for name, module in commands.items():
                subparsers.add_parser(name, help=_summary(module))
        _complete(parser)
        args = parser.parse_args(words)
        try:
            return int(args.run(args))
        except RollerError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1


def _complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that completes a line; argcomplete, which does it, need not be there."""
    if _COMPLETING in os.environ and importlib.util.find_spec("argcomplete"):
        import argcomplete

        argcomplete.autocomplete(parser)


def _describe(error: Exception) -> str:
    """In one line what went wrong that no command foresaw."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror:
        name = f"{error.filename}: " if error.filename else ""
        return f"{name if len(name) < 200 else name[:99] + '...: '}{error.strerror}"
    if isinstance(error, RuntimeError) and text.startswith("Symlink loop"):
        return text  # Python before 3.13 has no type for it
    if isinstance(error, UnicodeEncodeError):
        return f"{error.object[:200]!r}: a name that isn't UTF-8 can't be given there"
    if isinstance(error, ImportError):
        return f"{text}; see what `roller doctor` says, or run `make setup`"
    if isinstance(error, MemoryError):
        return f"there is not enough memory{' (' + text + ')' if text else ''}"
    if "rclpy" in sys.modules:
        from roller_ros.refusals import refused_name

        if refusal := refused_name(error):
            return refusal
    return describe_fault_of_ours(error)


if __name__ == "__main__":
    sys.exit(main())
