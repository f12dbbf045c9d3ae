"""`roller info`: what a recording holds."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from roller_core.command_help import add_examples


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `info` to the command's parser."""
    parser = subparsers.add_parser(
        "info",
        help="show what a recording holds",
        description="Decode all events of a rosbag2, ROS 1 bag, AEDAT4, Prophesee "
        "(EVT 3.0) or DSEC file or a folder of the public event-camera dataset and count them.",
    )
    parser.add_argument(
        "input",
        type=Path,
        metavar="INPUT",
        help="recording",
    )
    parser.add_argument("--topic", metavar="NAME", help="count only the events of this topic (all)")
    parser.add_argument(
        "--check",
        action="store_true",
        help="decode every message, look at every checksum, and say what is lost; the exit code is "
        "1 if anything is damaged",
    )
    add_examples(
        parser,
        "info scan",
        "info scan --check  # every message, and the index",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Count and print."""
    from roller_recording.reading.summary import summarise

    summary = summarise(args.input, args.topic, args.check)
    for line in summary.lines():
        print(line)
    for fault in summary.faults:
        print(f"error: {fault}", file=sys.stderr)
    return 1 if summary.faults else 0
