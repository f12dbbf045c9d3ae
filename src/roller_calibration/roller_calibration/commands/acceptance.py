"""`roller calibrate acceptance`: a cell's certificate, from passes over known gauges."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from roller_core.calibration_file import (
    SECTION,
    CalibrationError,
    calibration_record,
    same_camera,
)
from roller_core.camera import Camera
from roller_core.option_types import add_output
from roller_core.plain_json import to_text

from .acceptance_page import certificate_page
from .output import check_mm

#: Exit code where the cell isn't accepted, as of a part that is out of tolerance.
NOT_ACCEPTED = 3


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    from roller_inspect.commands.options import add_recording_options

    parser = kinds.add_parser(
        "acceptance",
        help="certificate: what the cell reaches against what the virtual cell promises",
        description="Measure a sphere, and steps and a flat plate if given, with the cell's "
        "calibration, and the virtual cell's own with this camera and speed; write "
        f"certificate.json and certificate.html. Exit: 0 accepted, {NOT_ACCEPTED} not accepted.",
    )
    parser.add_argument(
        "--sphere", type=Path, required=True, metavar="BAG", help="a pass over a sphere"
    )
    parser.add_argument(
        "--radius-mm", type=float, required=True, metavar="R", help="the sphere's radius"
    )
    parser.add_argument(
        "--steps", type=Path, metavar="BAG", help="a pass over equal steps, up and down"
    )
    parser.add_argument("--step-mm", type=float, metavar="H", help="height of a step")
    parser.add_argument(
        "--flat", type=Path, metavar="BAG", help="a pass over a flat plate with texture"
    )
    parser.add_argument(
        "--inspection", type=Path, metavar="DIR",
        help="result of `roller inspect` of a good part against its golden reference",
    )  # fmt: skip
    parser.add_argument(
        "--light", choices=("ring", "dome", "strong"), default="ring",
        help="the instrument's light: it travels with the camera (ring, the default, or "
        "strong) or not (dome)",
    )  # fmt: skip
    parser.add_argument("--skin", default="", metavar="NAME", help="name of the skin that is on")
    add_output(parser, "folder", required=True)
    add_recording_options(parser, "surface, emvs")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure, compare, write the certificate and say the verdict."""
    from roller_calibration.acceptance import golden_shortfalls
    from roller_core.output_folder import OutputFolder
    from roller_core.parameter_files import read_parameters
    from roller_inspect.pipeline import PipelineSettings

    check_mm("--radius-mm", args.radius_mm)
    if (args.steps is None) != (args.step_mm is None):
        raise CalibrationError("--steps and --step-mm go together")
    if args.steps is not None:
        check_mm("--step-mm", args.step_mm, 0.01, 10)
    settings = PipelineSettings.load(args.params, "surface").surface
    given = {
        "sphere": (args.sphere, args.radius_mm * 1e-3),
        "steps": (args.steps, (args.step_mm or 0.0) * 1e-3),
        "plate": (args.flat, 0.0),
    }
    bags = [bag for bag, _ in given.values() if bag is not None]
    inputs = (*bags, args.params, args.poses, args.camera, args.inspection)
    if args.poses and len(bags) > 1:
        raise CalibrationError("--poses goes with one recording; convert the others to bags")
    camera = _one_camera(bags, args, settings.max_pose_gap_s)
    inspection = _inspection(args.inspection, camera) if args.inspection else None
    with OutputFolder(args.output, "acceptance", inputs) as output:
        gauges, short = _measured(given, args, settings)
        if inspection is not None:
            short += golden_shortfalls(inspection)
        records = read_parameters(args.params, SECTION)
        certificate = calibration_record(
            args.skin, bags, camera,
            schema="roller-acceptance/2",
            verdict="not accepted" if short else "accepted",
            reasons=short,
            light=args.light,
            edge_drift=str(settings.edge_drift),
            gauges=gauges,
            golden=None if inspection is None else inspection.get("verdict"),
            calibrations={
                kind: str(r.get("date", "")) for kind, r in records.items() if isinstance(r, dict)
            },
        )  # fmt: skip
        (output.partial / "certificate.json").write_text(to_text(certificate))
        (output.partial / "certificate.html").write_text(certificate_page(certificate))
    for line in [certificate["verdict"].upper(), *short]:
        print(line)
    low, high = (1e3 * r for r in gauges["sphere"]["limits"]["radius_m"])
    print(f"the sphere's radius is judged as far as its light lets it: {low:.2f} to {high:.2f} mm")
    print(f"written to {args.output}")
    return NOT_ACCEPTED if short else 0


def _measured(
    given: dict[str, tuple[Path | None, float]], args: argparse.Namespace, settings: Any
) -> tuple[dict[str, Any], list[str]]:
    """What gauges reach, by name, beside what they should; and where they fall short.

    `given` holds of each its recording, None where there is none, and its size, m; `settings` are
    those of `surface`.
    """
    from roller_calibration.acceptance import accepted_radii, limits, promised, shortfalls
    from roller_calibration.reached import GAUGES
    from roller_calibration.recordings import read_scan

    gauges: dict[str, Any] = {}
    short: list[str] = []
    calibrated = settings.edge_drift.calibrated
    for name, (bag, size_m) in given.items():
        if bag is None:
            continue
        scan = read_scan(bag, args, settings.max_pose_gap_s)
        reached = GAUGES[name].measure(scan, settings, size_m)
        promise = promised(name, scan, args.light, reached.printed)
        least = limits(name, promise, accepted_radii(size_m, reached, args.light, calibrated))
        short += shortfalls(name, reached, least)
        gauges[name] = {
            "size_m": size_m, "reached": vars(reached), "promised": vars(promise),
            "limits": vars(least),
        }  # fmt: skip
    return gauges, short


def _one_camera(bags: Sequence[Path], args: argparse.Namespace, max_gap_s: float) -> Camera:
    """The camera of all recordings; that of another would be certified with what isn't its own."""
    from roller_recording.reading import open_recording

    cameras = [
        open_recording(bag, args.poses, args.camera, max_gap_s, args.topic).camera for bag in bags
    ]
    for bag, camera in zip(bags, cameras, strict=True):
        if not same_camera(camera, cameras[0]):
            raise CalibrationError(
                f"{bag} is of another camera ({camera}) than {bags[0]} ({cameras[0]})"
            )
    return cameras[0]


def _inspection(folder: Path, camera: Camera) -> dict[str, Any]:
    """An inspection of a part with the camera of the gauges."""
    from roller_inspect.report.document import SCHEMA

    path = folder / "inspection.json"
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise CalibrationError(f"{path}: can't be read ({error})") from error
    kind = found.get("schema") if isinstance(found, dict) else None
    parts = [found.get(key) for key in ("reference", "traceability")] if kind == SCHEMA else []
    if not (parts and all(isinstance(part, dict) for part in parts)):
        raise CalibrationError(f"{path}: is no inspection ({SCHEMA})")
    other = found["traceability"].get("camera")
    if other != str(camera):
        raise CalibrationError(
            f"{path}: the part was seen by another camera ({other}) than the gauges ({camera})"
        )
    return dict(found)
