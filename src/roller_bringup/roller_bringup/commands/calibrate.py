"""`roller calibrate`: what a cell's own recordings tell of it."""

from __future__ import annotations

import argparse
from datetime import datetime, timezone
from pathlib import Path

import yaml

from roller_bringup.progress import progress_bar
from roller_core.errors import RollerError, UnwritableOutputError
from roller_core.events import EventArray
from roller_emvs.calibration import Scan, TimeOffset, central_events, estimate_time_offset

from .options import add_recording_options

#: Nodes that put events together with poses.
_NODES = ("emvs", "surface", "braille")


class CalibrationError(RollerError):
    """A calibration that can't be made of what was given."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `calibrate` to the command's parser."""
    parser = subparsers.add_parser(
        "calibrate",
        help="calibrate the cell from recordings",
        description="With --time-offset: by how much event stamps lag the robot's poses, from "
        "recordings of scans that roll to and fro over a surface with relief. Two recordings at "
        "speeds that differ by half or more tell the delay from what edges lag by themselves.",
    )
    parser.add_argument(
        "inputs", type=Path, nargs="+", metavar="INPUT", help="recordings of scans that reverse"
    )
    parser.add_argument(
        "--time-offset", action="store_true", help="find the delay of event stamps against poses"
    )
    parser.add_argument(
        "--output", "-o", type=Path, metavar="FILE", help="parameter file to write for the nodes"
    )
    add_recording_options(parser, "the depth range of emvs")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Calibrate, print what was found and write it.

    Raises
    ------
    RollerError
        If a recording can't be read or tells nothing, or the file can't be written.
    """
    from roller_bringup.inspection import InspectionSettings

    if not args.time_offset:
        raise CalibrationError("say what to calibrate: --time-offset")
    if args.poses and len(args.inputs) > 1:
        raise CalibrationError("--poses goes with one recording; convert the others to bags")
    settings = InspectionSettings.load(args.params).depth
    scans = [_read(path, args, settings.max_pose_gap_s) for path in args.inputs]
    depth_m = 0.5 * (settings.depth_min_m + settings.depth_max_m)
    found = estimate_time_offset(scans, depth_m)
    for line in _told(found):
        print(line)
    if args.output:
        _write(args.output, found, args.inputs)
        print(f"written to {args.output}; give it to the nodes with params:= or --params")
    return 0


def _read(path: Path, args: argparse.Namespace, max_gap_s: float) -> Scan:
    from roller_bringup.recordings import open_recording

    recording = open_recording(path, args.poses, args.camera, max_gap_s, args.topic)
    parts = []
    with progress_bar(f"read {path.name}") as progress:
        for step in recording.steps():
            if step.faults:
                raise CalibrationError(f"{path}: {step.faults[0]}")
            if len(step.events):
                parts.append(central_events(step.events, recording.camera))
            if progress is not None:
                progress(step.progress)
    return Scan(EventArray.concatenate(parts), recording.camera, recording.track)


def _told(found: TimeOffset) -> list[str]:
    speeds = ", ".join(f"{v:.3g}" for v in found.speeds_m_s)
    lines = [
        f"event stamps lag the poses by {found.delay_s * 1e3:.3f} ms "
        f"± {found.deviation_s * 1e3:.3f} ms ({found.events} events, at {speeds} m/s)"
    ]
    if found.late_m is None:
        lines.append(
            "this holds what edges lag by themselves, about a tenth of a millimetre over the "
            "speed; give another recording at half or twice the speed to tell them apart"
        )
    else:
        lines.append(f"events come {found.late_m * 1e6:.0f} µm behind their edges at any speed")
    return lines


def _write(path: Path, found: TimeOffset, inputs: list[Path]) -> None:
    head = [
        f"# Time offset of events against poses, {datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC",
        *(f"# {line}" for line in _told(found)),
        f"# from {', '.join(p.name for p in inputs)}",
    ]
    values = {"ros__parameters": {"event_delay_s": round(found.delay_s, 7)}}
    body = "".join(yaml.safe_dump({node: values}) for node in _NODES)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(head) + "\n" + body, encoding="utf-8")
    except OSError as error:
        raise UnwritableOutputError(f"{path}: can't be written ({error.strerror})") from error
