"""`roller calibrate flat`: depth range from a rolling pass over a flat plate."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_core.calibration_file import CalibrationError, calibration_record

from .output import add_kind, check_mm, write

#: Nodes that search a depth range.
_NODES = ("emvs", "surface")


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    texts = (
        "depth range from a flat plate",
        "Nearest and farthest depth to search, from a pass over a flat plate with texture: the "
        "plate's depth over the whole image, the reach of relief and a margin. Only the part of "
        "the pass at one speed counts.",
    )
    parser = add_kind(kinds, "flat", run, "emvs", texts, skin=True)
    parser.add_argument(
        "inputs", type=Path, nargs=1, metavar="RECORDING", help="a pass over a flat plate"
    )
    parser.add_argument(
        "--reach-mm", type=float, default=1.5, metavar="MM",
        help="how far relief stands out of a plate, or sinks into it (default: 1.5)",
    )  # fmt: skip
    parser.add_argument(
        "--margin-mm",
        type=float,
        default=0.5,
        metavar="MM",
        help="beyond that, to either side (default: 0.5)",
    )
    parser.add_argument(
        "--search-mm", type=float, nargs=2, default=(38.0, 52.0), metavar=("NEAR", "FAR"),
        help="where the plate is looked for (default: 38 52)",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Find the plate, print the range and write it."""
    from roller_calibration.flat_pass import plate_of
    from roller_calibration.recordings import read_scans
    from roller_inspect.pipeline import PipelineSettings

    # Metres in place of millimetres would give a range that holds no relief.
    for option, value in (("--reach-mm", args.reach_mm), ("--margin-mm", args.margin_mm)):
        if value != 0:
            check_mm(option, value, 0.01, 50)
    for value in args.search_mm:
        check_mm("--search-mm", value, 1, 500)
    settings = PipelineSettings.load(args.params).depth
    near, far = (v * 1e-3 for v in args.search_mm)
    wide = type(settings).create(
        {**settings.model_dump(), "depth_min_m": near, "depth_max_m": far}, "--search-mm"
    )
    (scan,) = read_scans(args, settings.max_pose_gap_s)
    plate = plate_of(scan, wide)
    low, high = plate.depth_range_m(args.reach_mm * 1e-3, args.margin_mm * 1e-3)
    if low <= 0:
        raise CalibrationError(
            f"a reach of {args.reach_mm:g} mm passes the camera, {plate.depth_m * 1e3:.1f} mm away"
        )
    lines = [
        f"plate at {plate.depth_m * 1e3:.3f} mm on the axis, {plate.nearest_m * 1e3:.2f} to "
        f"{plate.farthest_m * 1e3:.2f} mm over the image (tilt {plate.tilt_deg[0]:+.2f}° along "
        f"the rows, {plate.tilt_deg[1]:+.2f}° along the columns); {plate.points} depths, "
        f"{plate.share:.0%} of the surface flat, {plate.scatter_m * 1e6:.0f} µm off at the median",
        f"depth range {low * 1e3:.2f} to {high * 1e3:.2f} mm: the plate, {args.reach_mm:g} mm of "
        f"relief and a margin of {args.margin_mm:g} mm to either side",
    ]
    print(*lines, sep="\n")
    values = {"depth_min_m": round(low, 6), "depth_max_m": round(high, 6)}
    record = calibration_record(
        args.skin, args.inputs, scan.camera,
        plate_m=plate.depth_m, tilt_deg=list(plate.tilt_deg), scatter_m=plate.scatter_m,
        reach_m=args.reach_mm * 1e-3, margin_m=args.margin_mm * 1e-3,
    )  # fmt: skip
    write(args, "flat", lines, {node: values for node in _NODES}, record)
    return 0
