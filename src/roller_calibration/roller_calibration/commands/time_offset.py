"""`roller calibrate time-offset`: by how much event stamps lag the robot's poses."""

from __future__ import annotations

import argparse
from pathlib import Path

from roller_calibration import Scan, TimeOffset, central_events, estimate_time_offset
from roller_core.calibration_file import account, write_calibration
from roller_inspect.commands.options import add_recording_options, add_written_options

from .reading import read_whole, refuse_shared_poses

#: Nodes that put events together with poses.
_NODES = ("emvs", "surface", "braille")


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        "time-offset",
        help="delay of event stamps against poses",
        description="By how much event stamps lag the robot's poses, from recordings of scans "
        "that roll to and fro over a surface with relief. Two recordings at speeds that differ by "
        "half or more tell the delay from what edges lag by themselves.",
    )
    parser.add_argument(
        "inputs", type=Path, nargs="+", metavar="INPUT", help="recordings of scans that reverse"
    )
    add_written_options(parser)
    add_recording_options(parser, "the depth range of emvs")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Calibrate, print what was found and write it.

    Raises
    ------
    RollerError
        If a recording can't be read or tells nothing, or the file can't be written.
    """
    from roller_inspect.pipeline import InspectionSettings

    refuse_shared_poses(args)
    settings = InspectionSettings.load(args.params).depth
    scans = []
    for path in args.inputs:
        rolled = read_whole(path, args, settings.max_pose_gap_s, central_events)
        scans.append(Scan(rolled.events, rolled.camera, rolled.track))
    depth_m = 0.5 * (settings.depth_min_m + settings.depth_max_m)
    found = estimate_time_offset(scans, depth_m)
    told = _told(found)
    for line in told:
        print(line)
    if args.output:
        delay = {"event_delay_s": round(found.delay_s, 7)}
        record = account(
            "", args.inputs, scans[0].camera,
            event_delay_s=float(found.delay_s), deviation_s=float(found.deviation_s),
            speeds_m_s=list(found.speeds_m_s),
        )  # fmt: skip
        write_calibration(
            args.output, "time_offset", told, {node: delay for node in _NODES}, record, args.params
        )
        print(f"written to {args.output}; give it to the nodes with params:= or --params")
    return 0


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
