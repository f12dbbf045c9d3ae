"""`roller calibrate time-offset`: by how much event stamps lag the robot's poses."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.calibration_file import calibration_record

from .output import add_kind, write

if TYPE_CHECKING:
    from roller_calibration.time_offset import TimeOffset

#: Nodes that put events together with poses.
_NODES = ("emvs", "surface", "braille")
#: How far the surface may move while a pixel is blind, metres: about the grain of a fine texture.
_FAR_M = 1.2e-4


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand."""
    texts = (
        "delay of event stamps against poses",
        "By how much event stamps lag the robot's poses, from recordings of scans that roll to "
        "and fro over fine texture, or else relief. Two recordings, at 0.1 and 0.5 m/s say, "
        "separate the delay from what edges lag by themselves.",
    )
    parser = add_kind(kinds, "time-offset", run, "the depth range of emvs", texts)
    parser.add_argument(
        "inputs", type=Path, nargs="+", metavar="INPUT", help="recordings of scans that reverse"
    )


def run(args: argparse.Namespace) -> int:
    """Calibrate, print what was found and write it."""
    from roller_calibration.bidirectional import central_events
    from roller_calibration.recordings import read_scans
    from roller_calibration.time_offset import estimate_time_offset
    from roller_inspect.pipeline import PipelineSettings

    settings = PipelineSettings.load(args.params).depth
    scans = read_scans(args, settings.max_pose_gap_s, central_events)
    found = estimate_time_offset(scans, 0.5 * (settings.depth_min_m + settings.depth_max_m))
    lines = _describe(found)
    print(*lines, sep="\n")
    delay = {"event_delay_s": round(found.delay_s, 7)}
    record = calibration_record(
        "", args.inputs, scans[0].camera,
        event_delay_s=float(found.delay_s), deviation_s=float(found.deviation_s),
        blind_s=found.blind_s, speeds_m_s=list(found.speeds_m_s),
    )  # fmt: skip
    write(args, "time_offset", lines, {node: delay for node in _NODES}, record)
    return 0


def _describe(found: TimeOffset) -> list[str]:
    speeds = ", ".join(f"{v:.3g}" for v in found.speeds_m_s)
    lines = [
        f"event stamps lag the poses by {found.delay_s * 1e3:.3f} ms "
        f"± {found.deviation_s * 1e3:.3f} ms ({found.events} events, at {speeds} m/s)"
    ]
    if found.late_m is None:
        lines.append(
            "this holds what edges lag by themselves, and so does ±: about a tenth of a "
            "millimetre over the speed; give another recording at half or twice the speed to "
            "separate them"
        )
    else:
        lines.append(f"events come {found.late_m * 1e6:.0f} µm behind their edges at any speed")
    if found.blind_s:
        lines.append(
            f"a pixel is blind for up to {found.blind_s * 1e3:.2f} ms after an event, a part of "
            "which may be taken for delay: ± allows for it"
        )
        meanwhile_m = found.blind_s * found.speeds_m_s[-1]
        if meanwhile_m > _FAR_M:
            lines.append(
                f"the surface moves by {meanwhile_m * 1e3:.2f} mm meanwhile: take the faster scan "
                f"at {_FAR_M / found.blind_s:.2g} m/s or less for a better figure"
            )
    return lines
