"""`roller calibrate scale`: millimetres a pixel from caliper readings."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_core.calibration_file import CalibrationError


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        "scale",
        help="scale from caliper readings",
        description="Scale at the sensor's surface, from openings of a caliper pressed on the skin "
        "and what the image shows of them; the paper takes two readings at 2, 3, 4 and 5 mm.",
    )
    parser.add_argument("--readings-mm", required=True, metavar="A,B,…", help="openings, mm")
    parser.add_argument("--pixels", required=True, metavar="A,B,…", help="the same in the image")
    parser.add_argument(
        "--camera", type=Path, metavar="FILE", help="calibration, to find the surface's depth"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the mean scale and its spread."""
    from roller_calibration.scale import PAPER_MM_PER_PX, PAPER_READINGS, scale_of
    from roller_core.camera import Camera

    readings_mm = _numbers(args.readings_mm, "--readings-mm", 0.1, 100, "mm")
    found = scale_of(readings_mm, _numbers(args.pixels, "--pixels", 1, 5000, "px"))
    print(
        f"{found.mm_per_px:.5f} mm/px ± {found.standard_error_mm_per_px:.5f} ({found.readings} "
        f"readings, standard deviation {found.deviation_mm_per_px:.5f}, spread "
        f"{found.spread:.1%}); the paper's is {PAPER_MM_PER_PX}"
    )
    if found.readings < PAPER_READINGS:
        print(f"the paper averages {PAPER_READINGS} readings")
    if args.camera:
        camera = Camera.from_yaml(args.camera)
        print(f"with this camera the surface is {found.mm_per_px * camera.fx:.2f} mm away")
    print("give it to the sphere's calibration with --scale-mm-per-px")
    return 0


def _numbers(text: str, option: str, least: float, most: float, unit: str) -> list[float]:
    try:
        found = [float(word) for word in text.split(",")]
    except ValueError as error:
        raise CalibrationError(f"{option}: expected numbers with commas, not '{text}'") from error
    for number, value in enumerate(found, 1):
        if not least <= value <= most:
            raise CalibrationError(
                f"{option}: reading {number} is {value:g}, expected {least:g} to {most:g} {unit}"
            )
    return found
