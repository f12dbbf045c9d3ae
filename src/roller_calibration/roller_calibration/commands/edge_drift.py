"""`roller calibrate edge-drift`: the drift of edges from a sphere and steps."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_core.calibration_file import calibration_record

from .output import add_kind, check_mm, write

#: Nodes that correct for it.
_NODES = ("emvs", "surface")


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    texts = (
        "drift of edges under the instrument's light, from a sphere and steps",
        "How far edges of each polarity drift while they cross the image, by slope and speed: "
        "from passes to and fro over a sphere of known radius and over steps of known height, each "
        "at two speeds or more, under the skin and the light that you work with. All recordings "
        "count together.",
    )
    parser = add_kind(kinds, "edge-drift", run, "surface, emvs", texts, skin=True)
    parser.add_argument(
        "--sphere", type=Path, action="append", required=True, metavar="BAG",
        help="a pass over a sphere; may be given several times",
    )  # fmt: skip
    parser.add_argument("--radius-mm", type=float, required=True, metavar="R", help="the sphere's")
    parser.add_argument(
        "--steps", type=Path, action="append", required=True, metavar="BAG",
        help="a pass over equal steps, up and down along the roll; may be given several times",
    )  # fmt: skip
    parser.add_argument(
        "--step-mm", type=float, required=True, metavar="H", help="height of a step"
    )


def run(args: argparse.Namespace) -> int:
    """Fit the drift, print it and write it."""
    from roller_calibration.drift_speed import speed_text
    from roller_calibration.edge_drift import fit_drift
    from roller_calibration.gauges import all_gauges
    from roller_calibration.recordings import read_scans
    from roller_core.progress import progress_bar
    from roller_inspect.pipeline import PipelineSettings

    check_mm("--radius-mm", args.radius_mm)
    check_mm("--step-mm", args.step_mm, 0.01, 10)
    settings = PipelineSettings.load(args.params, "surface").surface
    args.inputs = [*args.sphere, *args.steps]
    scans = read_scans(args, settings.max_pose_gap_s)
    spheres, steps = scans[: len(args.sphere)], scans[len(args.sphere) :]
    sizes = args.radius_mm * 1e-3, args.step_mm * 1e-3
    with progress_bar("fit lines") as progress:
        gauges, missing = all_gauges(spheres, steps, settings, *sizes, progress)
    found = fit_drift(gauges)
    lines = [f"{gauge.name}: {gauge.text}" for gauge in gauges]
    lines += [f"left out: {reason}" for reason in missing]
    for k, name in enumerate(("OFF", "ON")):
        before, after = found.before_m[k] * 1e6, found.after_m[k] * 1e6
        if not any((gauge.lines.polarity == k).any() for gauge in gauges):
            text = "not calibrated, no gauge tells what they are off by"
        elif found.corrected[k]:
            text = (
                f"{before:.0f} µm off at the median without the correction, {after:.0f} µm with it"
            )
        else:
            text = f"{before:.0f} µm off at the median, not corrected: no drift explains it"
        lines.append(f"{name} events on slopes: {text}")
    if not any(found.corrected):
        lines.append("nothing is corrected: the gauges show no drift that stands out")
    lines.append(speed_text(found.settings))
    lines.append(f"slopes up to {found.settings.max_slope:.2f}")
    print(*lines, sep="\n")
    record = calibration_record(
        args.skin, args.inputs, scans[0].camera,
        radius_m=args.radius_mm * 1e-3, step_m=args.step_mm * 1e-3,
        before_m=list(found.before_m), after_m=list(found.after_m),
    )  # fmt: skip
    # Each its own: parameter files have no aliases.
    values = {node: {"edge_drift": found.settings.model_dump(mode="json")} for node in _NODES}
    values["inspect"] = {"uncertainty": {"drift_m": found.left_on_slopes_m}}
    write(args, "edge_drift", lines, values, record)
    return 0
