"""`roller calibrate acceptance`: a cell's certificate, from passes over known gauges."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from html import escape
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

from .output import check_mm

#: Exit code where the cell isn't accepted, as of a part that is out of tolerance.
NOT_ACCEPTED = 3
_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:46em;margin:3em auto;padding:0 1em}"
    "table{border-collapse:collapse;width:100%}td,th{text-align:left;padding:.3em .6em;"
    "border-bottom:1px solid #bbb}.yes{color:#176b2c}.no{color:#a3161a}"
)


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
    from roller_calibration.acceptance import (
        accepted_radii,
        golden_shortfalls,
        limits,
        promised,
        shortfalls,
    )
    from roller_calibration.reached import GAUGES
    from roller_calibration.recordings import read_scan
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
        gauges: dict[str, Any] = {}
        short: list[str] = []
        for name, (bag, size_m) in given.items():
            if bag is None:
                continue
            scan = read_scan(bag, args, settings.max_pose_gap_s)
            reached = GAUGES[name].measure(scan, settings, size_m)
            promise = promised(name, scan, args.light, reached.printed)
            calibrated = settings.edge_drift.calibrated
            least = limits(name, promise, accepted_radii(size_m, reached, args.light, calibrated))
            short += shortfalls(name, reached, least)
            gauges[name] = {
                "size_m": size_m, "reached": vars(reached), "promised": vars(promise),
                "limits": vars(least),
            }  # fmt: skip
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
        (output.partial / "certificate.html").write_text(_page(certificate))
    for line in [certificate["verdict"].upper(), *short]:
        print(line)
    low, high = (1e3 * r for r in gauges["sphere"]["limits"]["radius_m"])
    print(f"the sphere's radius is judged as far as its light lets it: {low:.2f} to {high:.2f} mm")
    print(f"written to {args.output}")
    return NOT_ACCEPTED if short else 0


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


def _rows(name: str, gauge: dict[str, Any]) -> str:
    """A gauge's figures, one a row."""
    from roller_calibration.reached import GAUGES

    size = f", {gauge['size_m'] * 1e3:g} mm" if gauge["size_m"] else ""
    size += ", printed skin" if gauge["reached"]["printed"] else ""
    rows = f'<tr><th colspan="4">{name}{size}</th></tr>\n'
    form = (GAUGES[name].form, "form_m", 1e6, " µm", "≤ ")
    if (radii := gauge["limits"]["radius_m"]) is not None:
        low, high = (f"{r * 1e3:.2f}" for r in radii)
        shown = [f"{gauge[which]['radius_m'] * 1e3:.2f} mm" for which in ("reached", "promised")]
        shown.insert(1, f"{low} to {high} mm")
        rows += "<tr><td>radius as seen*</td>" + "".join(f"<td>{c}</td>" for c in shown) + "</tr>\n"
    for what, key, scale, unit, side in (
        ("mean error", "error_m", 1e6, " µm", "≤ "),
        *([form] if radii is None else []),
        ("seen", "coverage", 100, " %", "≥ "),
        ("errors within 2 σ", "within", 100, " %", "≥ "),
        ("points", "points", 1, "", ""),
    ):
        limit = gauge["limits"].get(key)
        cells = [f"{gauge[which][key] * scale:.0f}{unit}" for which in ("reached", "promised")]
        cells.insert(1, "–" if limit is None else f"{side}{limit * scale:.0f}{unit}")
        rows += f"<tr><td>{what}</td>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>\n"
    return rows


def _page(certificate: dict[str, Any]) -> str:
    """The certificate to print and sign."""
    rows = "".join(_rows(name, gauge) for name, gauge in certificate["gauges"].items())
    camera = certificate["camera"]
    facts = {
        "date": certificate["date"],
        "skin": certificate["skin"] or "–",
        "camera": f"{camera['width']}×{camera['height']}, fx {camera['intrinsics'][0]:.1f} px",
        "light": certificate["light"],
        "edge drift": certificate["edge_drift"],
        "golden scan": certificate["golden"] or "–",
        "recordings": ", ".join(certificate["data"]),
        "their SHA-256": ", ".join(text[:16] for text in certificate["sha256"]),
        "calibrations": ", ".join(f"{k} {v}" for k, v in certificate["calibrations"].items())
        or "–",
    }
    reasons = "".join(f"<li>{escape(line)}</li>" for line in certificate["reasons"])
    listed = "".join(
        f"<tr><th>{escape(k)}</th><td>{escape(str(v))}</td></tr>\n" for k, v in facts.items()
    )
    mark = "yes" if certificate["verdict"] == "accepted" else "no"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Acceptance</title>'
        f"<style>{_STYLE}</style></head><body><h1>Acceptance of the cell</h1>"
        f'<p><b class="{mark}">{certificate["verdict"].upper()}</b></p><ul>{reasons}</ul>'
        "<table><tr><th></th><th>this cell</th><th>limit</th><th>virtual cell</th></tr>\n"
        f"{rows}</table><p>The virtual cell's own gauges, with this camera and speed and without a "
        "calibration; under a printed skin where this cell's is, and its plate always.</p>"
        "<p>* Edges that drift bend a sphere, and no radius is measured more surely than they let "
        "it: one within the limit may be wrong by as much as that is wide. The virtual cell's "
        "sphere has 4 mm.</p>"
        f"<table>{listed}</table><p>Signed</p></body></html>\n"
    )
