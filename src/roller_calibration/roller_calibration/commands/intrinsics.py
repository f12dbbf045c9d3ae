"""`roller calibrate intrinsics`: focal length, centre and distortion from a grid of dots."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.calibration_file import CalibrationError
from roller_core.marked_file import SEAL, write_marked_file
from roller_core.option_types import add_output
from roller_core.output_overlap import refuse_overlap
from roller_core.progress import progress_bar

if TYPE_CHECKING:
    from roller_calibration.dot_grid import DotGrid, GridView
    from roller_recording.reading import Recording

#: How files of ours begin, so that none of others is replaced.
_PAGE_MARK = "<!doctype html><meta charset=utf-8><title>Target"
_CAMERA_MARK = "# camera_info, by roller calibrate intrinsics"

_TEXT = """\
Focal length, principal point and distortion of the event camera, from recordings of a grid of
dots that blinks on a phone or tablet (--target writes the page), or that is shaken by about a
dot's radius. The roller is open or off: no grid is seen through the skin. Hold the target still
for 2 s at each of 15 places or more, at the distance of the skin, up to the corners and tilted by
20 to 40°. Says how sharp the dots' edges are too: turn the lens until that is smallest, at the
distance of the skin."""
_EXAMPLES = """\
examples:
  roller calibrate intrinsics --target target.html          # open full screen, measure its pitch
  roller record --output views                              # camera running, robot not needed
  roller calibrate intrinsics views --pitch-mm 6.9 --output camera.yaml"""


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        "intrinsics",
        help="focal length, centre and distortion, from a grid of dots",
        description=_TEXT,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("inputs", nargs="*", type=Path, metavar="RECORDING", help="bags or files")
    add_grid_options(parser)
    parser.add_argument("--target", type=Path, metavar="FILE.html", help="write the blinking page")
    parser.add_argument("--topic", metavar="NAME", help="topic of the event packets")
    add_output(parser, "ROS camera_info YAML to write", "FILE")
    parser.set_defaults(run=run)


def add_grid_options(parser: argparse.ArgumentParser) -> None:
    """Add what is said of the target."""
    parser.add_argument(
        "--pitch-mm", type=float, metavar="MM", help="distance of neighbouring dots of a row"
    )
    parser.add_argument(
        "--grid", default="4x11", metavar="COLUMNSxROWS", help="dots a row and rows (default 4x11)"
    )


def run(args: argparse.Namespace) -> int:
    """Find the intrinsics, print them and write them."""
    from roller_calibration.dot_grid import target_page
    from roller_calibration.intrinsics import check_one_lens, find_intrinsics
    from roller_recording.reading.uncalibrated import open_uncalibrated

    for output in (args.output, args.target):
        for source in args.inputs if output else ():
            if source.is_dir():
                refuse_overlap(source, output)
    if args.target:
        grid = grid_of(args, 6.0)
        write_marked_file(args.target, f"{target_page(grid)}<!-- {SEAL} -->\n", _PAGE_MARK)
        print(f"written to {args.target}; open it full screen and measure the dots' pitch")
        if not args.inputs:
            return 0
    if not args.inputs:
        raise CalibrationError("give a RECORDING of the grid, or --target FILE.html to make one")
    grid = grid_of(args)
    views, sizes, parts = [], set(), {}
    for path in args.inputs:
        recording = open_uncalibrated(path, args.topic)
        sizes.add((recording.camera.width, recording.camera.height))
        parts[str(path)] = found_here = find_views(recording, grid, path)
        views += found_here
    if len(sizes) > 1:
        raise CalibrationError(f"the recordings are of different image sizes: {sorted(sizes)} px")
    size = sizes.pop()
    found = find_intrinsics(views, grid, size)
    if len(parts) == 1:
        half = len(views) // 2
        parts = {"the first half of the views": views[:half], "the second": views[half:]}
    check_one_lens(parts, grid, size)
    c, s = found.camera, found.deviation
    edge = sorted(view.edge_px for view in views)[len(views) // 2]
    print(
        f"focal length {c.fx:.1f} ± {s[0]:.1f}, {c.fy:.1f} ± {s[1]:.1f} px; centre {c.cx:.1f} ± "
        f"{s[2]:.1f}, {c.cy:.1f} ± {s[3]:.1f} px",
        "distortion k1 k2 p1 p2: " + ", ".join(f"{d:+.4f}" for d in c.distortion[:4]),
        f"{found.views} views, {found.left_out} left out; dots off by {found.rms_px:.3f} px rms; "
        f"{found.covered:.0%} of the image seen; edges {edge:.1f} px wide",
        sep="\n",
    )
    if found.longer:
        print(
            f"the focal length along the rows is {abs(found.longer):.1%} "
            f"{'longer' if found.longer > 0 else 'shorter'} than along the columns: is the "
            "target's pitch the same both ways?"
        )
    if found.covered < 0.6:
        print("the dots cover little of the image: hold the target into its corners too")
    if args.output:
        note = f"# {found.views} views, {found.rms_px:.3f} px rms\n"
        text = f"{_CAMERA_MARK}\n{note}# {SEAL}\n{c.yaml_text()}"
        write_marked_file(args.output, text, _CAMERA_MARK)
        print(f"written to {args.output}; give it to the cell with camera_info:=file://…")
    return 0


def grid_of(args: argparse.Namespace, usual_mm: float | None = None) -> DotGrid:
    """The target as the options describe it.

    Raises
    ------
    CalibrationError
        If they make no sense.
    """
    from roller_calibration.dot_grid import DotGrid

    pitch_mm = args.pitch_mm if args.pitch_mm is not None else usual_mm
    if pitch_mm is None:
        raise CalibrationError("give --pitch-mm: the distance of neighbouring dots of a row")
    words = args.grid.lower().split("x")
    if len(words) != 2 or not all(w.isdecimal() and 2 <= int(w) <= 50 for w in words):
        raise CalibrationError(f"--grid {args.grid}: expected COLUMNSxROWS, such as 4x11")
    if int(words[1]) % 2 == 0:
        raise CalibrationError(
            f"--grid {args.grid}: the number of rows must be odd, or the grid has two ways round"
        )
    if not (math.isfinite(pitch_mm) and 0.1 <= pitch_mm <= 500):
        raise CalibrationError(f"--pitch-mm {pitch_mm:g}: expected 0.1 to 500 mm")
    return DotGrid(pitch_mm * 1e-3, int(words[0]), int(words[1]))


def find_views(recording: Recording, grid: DotGrid, path: Path) -> list[GridView]:
    """Views of the grid in a recording; what was wrong with it is printed.

    Raises
    ------
    CalibrationError
        If the grid isn't seen.
    """
    from roller_calibration.dot_grid import GridWatcher

    watcher = GridWatcher(recording.camera, grid)
    with progress_bar(f"look for the grid in {path.name}") as progress:
        for step in recording.items():
            for fault in step.faults:
                print(f"{path}: {fault}")
            watcher.add_events(step.events)
            progress(step.progress)
    views = watcher.finish()
    edges = f"; edges {watcher.edge_px:.1f} px wide" if watcher.found else ""
    print(
        f"{path}: the grid is in {watcher.found} of {watcher.windows} windows; {len(views)} views"
        f"{edges}"
    )
    if not watcher.found:
        raise CalibrationError(
            f"{path}: the grid ({grid.columns}×{grid.rows} dots) isn't seen: does it blink, is it "
            "whole in the image, is --grid right?"
        )
    if not views:
        raise CalibrationError(
            f"{path}: the grid ({grid.columns}×{grid.rows} dots) isn't seen standing still: hold "
            f"it still for 2 s at each place; its edges are {watcher.edge_px:.1f} px wide"
        )
    return views
