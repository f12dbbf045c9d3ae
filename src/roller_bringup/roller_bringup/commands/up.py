"""`roller up`: run a launch file, also where `ros2 launch` is absent."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_bringup import launching
from roller_bringup.launching import LaunchError, locate
from roller_core.command_help import add_examples

_SUFFIX = ".launch.xml"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `up` to the command's parser."""
    parser = subparsers.add_parser(
        "up",
        help="run a launch file",
        description="Run a ROS 2 launch file (XML), as `ros2 launch` does, without it.",
    )
    parser.add_argument("file", metavar="FILE", help="a launch file, or the name of one of ours")
    parser.add_argument(
        "arguments", metavar="name:=value", nargs="*", help="arguments of the launch file"
    )
    parser.add_argument(
        "-s", "--show-args", action="store_true", help="list the launch file's arguments and stop"
    )
    add_examples(
        parser,
        "up virtual.launch.xml scene:=stairs speed:=0.3",
        "up virtual.launch.xml --show-args",
        "up cell.launch.xml robot_ip:=192.168.0.10",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the launch file, or list its arguments."""
    path = find(args.file)
    if args.show_args:
        show(path)
        return 0
    return launching.run(launching.load(path, split(args.arguments)))


def find(name: str) -> Path:
    """Find a launch file: a path, or a file of ours with or without its ending.

    Raises
    ------
    LaunchError
        There is none.
    """
    path = Path(name)
    if path.is_file():
        return path
    ours: list[str] = []
    if path.name == name:
        try:
            folder = locate.package_share("roller_bringup") / "launch"
        except locate.NotFoundError as error:
            raise LaunchError(str(error)) from None
        for candidate in (folder / name, folder / f"{name}{_SUFFIX}"):
            if candidate.is_file():
                return candidate
        ours = sorted(file.name for file in folder.glob(f"*{_SUFFIX}"))
    hint = f"; ours are {', '.join(ours)}" if ours else ""
    raise LaunchError(f"there is no launch file {name}{hint}")


def split(words: list[str]) -> dict[str, str]:
    """Split name:=value.

    Raises
    ------
    LaunchError
        A word isn't one, or a name comes twice.
    """
    found: dict[str, str] = {}
    for word in words:
        name, separator, value = word.partition(":=")
        if not separator or not name:
            raise LaunchError(f"{word!r} is not an argument; write name:=value")
        if name in found:
            raise LaunchError(f"the argument '{name}' is given twice")
        found[name] = value
    return found


def show(path: Path) -> None:
    """Print the arguments of a launch file."""
    arguments = launching.list_arguments(path)
    print(f"Arguments of {path.name} (name:=value):")
    if not arguments:
        print("  none")
    for argument in arguments:
        default = "must be given" if argument.default is None else f"default: '{argument.default}'"
        print(f"  {argument.name} ({default})")
        if argument.description:
            print(f"      {argument.description}")
