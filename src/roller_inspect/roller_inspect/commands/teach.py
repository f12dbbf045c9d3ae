"""`roller inspect teach`: a golden reference from scans of good parts."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roller_core.command_help import add_examples
from roller_core.option_types import Once, add_output
from roller_core.progress import progress_bar

from .options import add_method_option, recipe_file

if TYPE_CHECKING:
    from roller_inspect.height_map import HeightMap
    from roller_inspect.references.measured_by import MeasuredBy

#: Method of recordings where none is named.
_METHOD = "surface"


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
    add_method_option(parser, None, _METHOD)
    parser.add_argument(
        "--params", action=Once, type=Path, metavar="FILE", help="ROS 2 parameter file"
    )
    parser.add_argument(
        "--recipe",
        type=Path,
        metavar="FILE",
        help="recipe, for its grid (that of --params, or the default)",
    )
    add_examples(parser, "inspect teach good_1 good_2 good_3 --output golden")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make a map of each scan, and the reference of all."""
    from roller_core.output_folder import OutputFolder
    from roller_inspect.references import teach
    from roller_inspect.references.measured_by import check_alike

    args.recipe = recipe_file(args.recipe, args.params)
    with OutputFolder(args.output, "teach", [*args.scans, args.params, args.recipe]) as output:
        maps, made = [], _asked(args)
        for scan in args.scans:
            height_map, made[str(scan)] = _map(args, scan)
            check_alike(made)
            maps.append(height_map)
        golden = teach(maps, _warn)
        golden.save(output.partial)
    cells, step_m = int((golden.height_m == golden.height_m).sum()), golden.x_m[1] - golden.x_m[0]
    scans = f"{golden.scans} scan{'s' if golden.scans > 1 else ''}"
    print(f"golden reference of {scans}, {cells * step_m**2 * 1e6:.0f} mm² are known")
    reference = shlex.quote(f"golden:{args.output}")
    print(f"use it: roller inspect SCAN --output DIR --reference {reference}")
    return 0


def _warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


def _check(scan: Path, faults: Sequence[str], totals: Mapping[str, Any]) -> None:
    """Refuse a scan with faults: what is missing there would be allowed for good."""
    from roller_core.seq_gaps import MOST_MISSING
    from roller_inspect.height_map import HeightMapError

    lost = totals.get("lost_packets", 0)
    share = lost / max(totals.get("packets", 0) + lost, 1)
    if share > MOST_MISSING:
        faults = [*faults, f"{share:.0%} of the event packets were lost"]
    if faults:
        raise HeightMapError(f"{scan}: nothing is learnt from a scan with faults: {faults[0]}")


def _asked(args: argparse.Namespace) -> dict[str, MeasuredBy]:
    """What the options ask for, as far as they are given."""
    from roller_inspect.pipeline import PipelineSettings
    from roller_inspect.recipe import load_recipe
    from roller_inspect.references.measured_by import MeasuredBy

    if args.method is None and args.params is None and args.recipe is None:
        return {}
    grid_m = load_recipe(args.recipe).grid_m if args.recipe is not None else 0.0
    if args.method is None and args.params is None:
        return {"--recipe": MeasuredBy(grid_m=grid_m)}
    s = PipelineSettings.load(args.params, args.method or _METHOD).for_inspection()
    settings = {
        "emvs": s.depth.model_dump(), "stitcher": s.stitcher.model_dump(),
        "surface": s.surface.model_dump(),
    } if args.params is not None else {}  # fmt: skip
    asked = MeasuredBy.of(args.method or _METHOD, settings, "", grid_m)
    return {"the options ask for": asked}


def _map(args: argparse.Namespace, scan: Path) -> tuple[HeightMap, MeasuredBy]:
    """The map of a scan: from a result that is there, or by inspecting the recording."""
    from tempfile import TemporaryDirectory

    from roller_core.calibration_file import check_same_camera
    from roller_core.outputs import Result
    from roller_inspect.height_map import HeightMap, HeightMapError
    from roller_inspect.inspect_stage import InspectStage, inspect_parameters
    from roller_inspect.judgement import Inspected
    from roller_inspect.pipeline import PipelineSettings
    from roller_inspect.recipe import load_recipe
    from roller_inspect.references.measured_by import MeasuredBy
    from roller_inspect.replay import replay
    from roller_recording.reading import open_recording

    if (scan / "height_map.npz").is_file():
        document, report = (
            json.loads(path.read_text()) if path.exists() else {}
            for path in (scan / "inspection.json", scan / "report.json")
        )
        faults = [*document.get("faults", []), *document.get("contact", [])]
        _check(scan, faults, report.get("totals", {}))
        made = MeasuredBy.of(
            report.get("method", ""), report.get("settings", {}),
            document.get("traceability", {}).get("camera", ""),
            document.get("recipe", {}).get("grid_m", 0.0),
        )  # fmt: skip
        return HeightMap.load(scan / "height_map.npz"), made
    settings = PipelineSettings.load(args.params, args.method or _METHOD)
    recording = open_recording(scan, None, None, settings.max_pose_gap_s, None)
    check_same_camera(args.params, recording.camera)
    recipe = load_recipe(args.recipe).changed({"reference": "self"})
    stage = InspectStage(inspect_parameters(args.params), recipe)
    parts: list[Inspected] = []

    def take(result: Result) -> None:
        if isinstance(result.found, Inspected):
            parts.append(result.found)

    with TemporaryDirectory() as folder, progress_bar(f"teach {scan.name}") as progress:
        done = replay(recording, settings, Path(folder), scan, False, progress, stage, take)
    faults = [f"it is of {len(parts)} parts"] if len(parts) > 1 else []
    contact = [line for part in parts for line in part.judgement.contact]
    _check(scan, [*faults, *done.faults, *contact], done.totals)
    height_map = parts[0].found.height_map if parts else None
    if height_map is None:
        raise HeightMapError(f"{scan}: nothing was measured; a reference needs texture")
    camera = str(recording.camera)
    return height_map, MeasuredBy.of(done.method, done.settings, camera, recipe.grid_m)
