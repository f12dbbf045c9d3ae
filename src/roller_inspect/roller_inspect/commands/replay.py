"""`roller replay`: process a recording offline."""

from __future__ import annotations

import argparse
import sys

from roller_core.command_help import add_examples
from roller_core.errors import RollerError
from roller_core.progress import progress_bar

from .options import add_processing_options, open_input


class NothingCameError(RollerError):
    """Input that gives nothing, where an earlier result would be lost for it."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `replay` to the command's parser."""
    parser = subparsers.add_parser(
        "replay",
        help="process a recording offline",
        description="Process a rosbag2 (folder or file), a ROS 1 bag, an AEDAT4 or Prophesee file "
        "(EVT 3.0), DSEC's HDF5 or a folder of the public event-camera dataset with the pipeline "
        "of the nodes.",
    )
    add_processing_options(parser)
    add_examples(
        parser,
        "replay scan --output result",
        "replay scan --output paper --method bma",
        "replay events.raw --poses poses.txt --camera camera.yaml --output result",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay, draw the overview and say what came of it."""
    from roller_core.output_folder import OutputFolder
    from roller_inspect.pipeline import PipelineSettings
    from roller_inspect.replay import replay
    from roller_inspect.results.summary import summary

    settings = PipelineSettings.load(args.params, args.method)
    inputs = (args.input, args.params, args.poses, args.camera)
    with OutputFolder(args.output, "replay", inputs, always=["report.json"]) as output:
        recording = open_input(args, settings)
        done = 0.0

        def show(share: float) -> None:
            nonlocal done
            done = share
            progress(share)

        try:
            with progress_bar(f"replay {args.input.name}") as progress:
                report = replay(
                    recording, settings, output.partial, args.input, not args.no_braille, show
                )
        except KeyboardInterrupt:
            print(
                f"{args.input}: {1 - done:.0%} of it were not processed, nothing is written",
                file=sys.stderr,
            )
            raise
        if report.faults and report.is_empty and output.holds_earlier:
            for line in report.faults[1:]:
                print(f"error: {line}", file=sys.stderr)
            raise NothingCameError(
                f"{report.faults[0]}; nothing came of it, so the earlier result in {args.output} "
                "stays"
            )
        if not args.no_picture:
            from roller_inspect.results.overview import draw_overview

            draw_overview(output.partial, args.input)
    print(summary(report, args.output))
    for line in report.faults:
        print(f"error: {line}", file=sys.stderr)
    return 1 if report.faults else 0
