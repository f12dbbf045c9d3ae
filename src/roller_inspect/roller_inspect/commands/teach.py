"""`roller inspect teach`: a golden reference from scans of good parts."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.command_help import add_examples
from roller_core.option_types import add_output
from roller_core.progress import progress_bar

from .options import add_method_option

if TYPE_CHECKING:
    from roller_inspect.height_map import HeightMap


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `inspect teach` to the command's parser."""
    parser = subparsers.add_parser(
        "inspect-teach",
        prog="roller inspect teach",
        description="Learn from scans of good parts in the same place what they look like; "
        "`roller inspect --reference golden:DIR` holds others against it.",
    )
    parser.add_argument(
        "scans", type=Path, nargs="+", metavar="SCAN", help="recordings, or results of inspect"
    )
    add_output(parser, "the reference", required=True)
    add_method_option(parser, "surface")
    parser.add_argument("--params", type=Path, metavar="FILE", help="ROS 2 parameter file")
    parser.add_argument("--recipe", type=Path, metavar="FILE", help="recipe, for its grid")
    add_examples(parser, "inspect teach good_1 good_2 good_3 --output golden")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make a map of each scan, and the reference of all."""
    from roller_core.output_folder import OutputFolder
    from roller_inspect.references import teach

    with OutputFolder(args.output, "teach", [*args.scans, args.params, args.recipe]) as output:
        golden = teach([_map(args, scan) for scan in args.scans], _warn)
        golden.save(output.partial)
    known = float((golden.height_m == golden.height_m).mean())
    print(f"golden reference of {golden.scans} scans, {known:.1%} of its cells known")
    print(f"use it: roller inspect SCAN --output DIR --reference golden:{args.output}")
    return 0


def _warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


def _check(scan: Path, faults: list[str]) -> None:
    """Refuse a scan with faults: what is missing there would be allowed for good."""
    from roller_inspect.height_map import HeightMapError

    if faults:
        raise HeightMapError(f"{scan}: nothing is learnt from a scan with faults: {faults[0]}")


def _map(args: argparse.Namespace, scan: Path) -> HeightMap:
    """The map of a scan: from a result that is there, or by inspecting the recording."""
    from tempfile import TemporaryDirectory

    from roller_core.outputs import Result
    from roller_inspect.height_map import HeightMap, HeightMapError
    from roller_inspect.inspect_stage import InspectParameters, InspectStage
    from roller_inspect.judgement import Inspected
    from roller_inspect.pipeline import PipelineSettings
    from roller_inspect.recipe import load_recipe
    from roller_inspect.replay import replay
    from roller_recording.reading import open_recording

    if (scan / "height_map.npz").is_file():
        document = scan / "inspection.json"
        if document.exists():
            _check(scan, json.loads(document.read_text()).get("faults", []))
        return HeightMap.load(scan / "height_map.npz")
    settings = PipelineSettings.load(args.params, args.method)
    recording = open_recording(scan, None, None, settings.max_pose_gap_s, None)
    recipe = load_recipe(args.recipe).changed({"reference": "self"})
    stage = InspectStage(InspectParameters.create({}), recipe)
    maps: list[HeightMap] = []

    def take(result: Result) -> None:
        if isinstance(result.found, Inspected) and result.found.found.height_map is not None:
            maps.append(result.found.found.height_map)

    with TemporaryDirectory() as folder, progress_bar(f"teach {scan.name}") as progress:
        report = replay(recording, settings, Path(folder), scan, False, progress, stage, take)
    _check(scan, report.faults)
    if not maps:
        raise HeightMapError(f"{scan}: nothing was measured; a reference needs texture")
    return maps[-1]
