"""`roller calibrate sphere`: the parameters of a method from passes over a sphere."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.calibration_file import (
    CalibrationError,
    calibration_record,
    check_same_camera,
    read_record,
)
from roller_core.progress import progress_bar

from .output import add_kind, check_mm, write

if TYPE_CHECKING:
    from roller_calibration.contact import ContactWindow
    from roller_calibration.error_table import ErrorSummary
    from roller_calibration.recordings import Scan
    from roller_calibration.sphere import Sphere
    from roller_emvs.depth_settings import DepthSettings

METHODS = ("bma", "focus")
#: How far the sphere's top may be found from the height that is given, mm.
_MOST_TOP_MM = 1.0


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    texts = (
        "parameters of a method from passes over a sphere",
        "Grid search over the parameters of the paper's method (threshold C, median G_f, weights "
        "of the views) or of focus, on rolling passes over a sphere of known radius: the least "
        "mean absolute error within the contact circle that measures no less of it.",
    )
    parser = add_kind(kinds, "sphere", run, "emvs", texts, skin=True)
    parser.add_argument(
        "inputs", type=Path, nargs="+", metavar="RECORDING", help="passes over the one sphere"
    )
    parser.add_argument("--radius-mm", type=float, required=True, metavar="R", help="the sphere's")
    parser.add_argument(
        "--method", choices=METHODS, default="bma", help="what is calibrated (default: bma)"
    )
    parser.add_argument(
        "--previous", type=Path, metavar="FILE",
        help="an earlier calibration: where the search starts, and what it is compared with",
    )  # fmt: skip
    parser.add_argument(
        "--least-coverage", type=float, metavar="SHARE",
        help="share of the contact circle that must be measured (default: as much as before)",
    )  # fmt: skip
    parser.add_argument(
        "--weight-parts", type=int, default=18, metavar="N",
        help="weights are multiples of 1/N (default: 18, which holds the paper's)",
    )  # fmt: skip
    parser.add_argument(
        "--top-height-mm", type=float, metavar="Z",
        help="height of the sphere's top in base, where it is known; else the sphere is put where "
        "most depths of focus lie",
    )  # fmt: skip
    parser.add_argument(
        "--scale-mm-per-px", type=float, metavar="F",
        help="scale by caliper, checked against the camera's calibration",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Calibrate, print what was found and write it."""
    begin = time.perf_counter()
    _check(args)
    settings = _settings(args)
    from roller_calibration.grid_search import make_search
    from roller_calibration.grids import check_weights
    from roller_calibration.parameter_choice import choose_parameters
    from roller_calibration.pauses import without_pauses
    from roller_calibration.recordings import read_scans

    from .sphere_report import describe_changes, describe_choice, describe_spheres

    if args.method == "bma":
        check_weights(settings)
    passes = [without_pauses(scan) for scan in read_scans(args, settings.max_pose_gap_s)]
    camera = passes[0].camera
    check_same_camera(args.previous, camera)
    spheres, windows = _find(passes, settings, args)
    found = describe_spheres(passes, spheres, windows, args)
    print(*found, sep="\n")
    search = make_search(args, settings, windows, camera)
    groups = [w.name if len(passes) > 1 else str(k) for k, w in enumerate(windows)]
    choice = choose_parameters(search, settings, args.least_coverage, groups)
    lines = describe_choice(choice, "recordings" if len(passes) > 1 else "windows")
    lines += search.notes
    previous = read_record(args.previous, "sphere") if args.previous else None
    if previous is not None:
        lines += describe_changes(previous, args, choice)
    print(*lines, sep="\n")
    total_s = time.perf_counter() - begin
    print(
        f"{total_s:.1f} s, of which the search of {search.grid.size} choices over {len(windows)} "
        f"windows took {choice.search_s:.1f} s"
    )
    record = calibration_record(
        args.skin, args.inputs, camera,
        method=args.method, radius_m=args.radius_mm * 1e-3,
        contact_radii_m=[round(s.contact_radius_m, 7) for s in spheres],
        fitted_radii_m=[round(s.fitted_radius_m, 7) for s in spheres],
        windows=len(windows), least_coverage=round(float(choice.least_coverage), 6),
        before=_rounded(choice.before), after=_rounded(choice.after),
    )  # fmt: skip
    if choice.held_out is not None:
        record["held_out"] = _rounded(choice.held_out)
    write(args, "sphere", found + lines, {"emvs": choice.values}, record)
    return 0


def _rounded(summary: ErrorSummary) -> dict[str, float]:
    return {"error_m": round(summary.error_m, 9), "coverage": round(summary.coverage, 6)}


def _check(args: argparse.Namespace) -> None:
    check_mm("--radius-mm", args.radius_mm)
    if not 2 <= args.weight_parts <= 60:
        raise CalibrationError(f"--weight-parts {args.weight_parts}: expected 2 to 60")
    if args.least_coverage is not None and not 0 < args.least_coverage <= 1:
        raise CalibrationError(f"--least-coverage {args.least_coverage:g}: expected 0 to 1")


def _settings(args: argparse.Namespace) -> DepthSettings:
    """Settings of the start: the defaults, `--params`, then what `--previous` calibrated."""
    from roller_calibration.grid_search import NAMES
    from roller_core.parameter_files import read_parameters
    from roller_inspect.pipeline import PipelineSettings

    settings = PipelineSettings.load(args.params, args.method).depth
    if args.previous is None:
        return settings
    if read_record(args.previous, "sphere") is None:
        raise CalibrationError(f"{args.previous}: not a calibration by a sphere")
    found = read_parameters(args.previous, "emvs")
    calibrated = (name.split(".") for name in NAMES[args.method])
    kept = {f"{g}.{n}": found[g][n] for g, n in calibrated if n in found.get(g, {})}
    return settings.changed(kept)


def _at_height(name: str, sphere: Sphere, top_mm: float) -> Sphere:
    """The sphere with its top at a known height, z in base."""
    found_mm = sphere.top_m[2] * 1e3
    if not abs(top_mm - found_mm) <= _MOST_TOP_MM:
        raise CalibrationError(
            f"{name}: --top-height-mm {top_mm:g}: the depths have the sphere's top at z = "
            f"{found_mm:.2f} mm in base, more than {_MOST_TOP_MM:g} mm away; is it in millimetres?"
        )
    return sphere.moved_to_top(top_mm * 1e-3)


def _find(
    passes: Sequence[Scan], settings: DepthSettings, args: argparse.Namespace
) -> tuple[list[Sphere], list[ContactWindow]]:
    """The sphere of each pass, and the windows of the method that show it whole."""
    from roller_calibration.contact import contact_windows, pass_points
    from roller_calibration.grid_search import window_settings
    from roller_calibration.sphere import SphereError, find_sphere

    spheres: list[Sphere] = []
    windows: list[ContactWindow] = []
    with progress_bar("find the sphere") as progress:
        for k, scan in enumerate(passes):
            points, towards = pass_points(scan, settings)
            try:
                sphere = find_sphere(points, towards, args.radius_mm * 1e-3)
            except SphereError as error:
                raise CalibrationError(f"{scan.name}: {error}") from error
            if args.top_height_mm is not None:
                sphere = _at_height(scan.name, sphere, args.top_height_mm)
            spheres.append(sphere)
            windows += contact_windows(scan, window_settings(settings), sphere)
            progress((k + 1) / len(passes))
    return spheres, windows
