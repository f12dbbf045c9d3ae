"""A Braille plate read as a node reads it, and how well."""

from __future__ import annotations

from dataclasses import asdict
from functools import lru_cache

import numpy as np

from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import BrailleSettings
from roller_core.pose_track import PoseTrack
from roller_sim.braille import DOT_PITCH_MM
from roller_sim.cell import VirtualCell

from .braille_score import score
from .cases import Case, ScanCase
from .rows import Row
from .scans import Scan

#: The paper's batch of events, to which times are scaled.
BATCH_EVENTS = 20_000
#: Text whose middle cell has dots enough to measure them.
_DOTS = "qqq"


def measure_braille(case: Case, scan: Scan) -> list[Row]:
    """How well and how fast a plate is read, and the contrast of its dots.

    The case's settings: `reader`, those of the reader that aren't the defaults, and
    `speed_factor`, the poses' speed by the true one.
    """
    reader = BrailleSettings.create(dict(case.settings["reader"]))
    # The pipeline forgets poses that it no longer needs.
    track = with_wrong_speed(scan.track, case.settings.get("speed_factor", 1.0))
    pipeline = BraillePipeline(reader, scan.camera, track)
    for events in scan.packets:
        pipeline.add_events(events)
        for _ in pipeline.results():
            pass
    for _ in pipeline.results(flush=True):
        pass
    lines, count = pipeline.text(), pipeline.counts.events
    result = score(lines, scan.truth.text.split("\n"))
    ms = np.array(list(pipeline.milliseconds) or [0.0])
    # Batches end after some travel too; the cost of the same work in batches of the paper's size.
    batches = max(count / BATCH_EVENTS, 1e-9)
    row = {
        "threshold": scan.truth.settings.sensor.threshold,
        "dot_contrast": dot_contrast(case.scan),
        **asdict(result),
        "misread": result.misread,
        "character_accuracy": result.character_accuracy,
        "character_error_rate": result.character_error_rate,
        "word_error_rate": result.word_error_rate,
        "batches": len(pipeline.milliseconds),
        "events": count,
        "ms_mean": float(ms.mean()),
        "ms_p95": float(np.quantile(ms, 0.95)),
        "ms_20000_events": float(ms.sum() / batches),
        "text": lines,
    }
    return [row]


def with_wrong_speed(track: PoseTrack, factor: float) -> PoseTrack:
    """The track of a robot that says it goes so many times as fast as it does."""
    out = PoseTrack(track.max_gap_s)
    origin = track.positions[0]
    for t, p, q in zip(track.times_ns, track.positions, track.quaternions, strict=True):
        out.append(int(t), np.asarray(p if factor == 1.0 else origin + (p - origin) * factor), q)
    return out


@lru_cache(maxsize=8)
def dot_contrast(scan: ScanCase) -> float:
    """By how much a Braille dot changes the log intensity that a pixel sees.

    The median, over a few dots in the middle of the view, of the span of log intensity around one;
    without the coating's speckle. An event needs a change by the sensor's threshold.

    Parameters
    ----------
    scan : ScanCase
        Text and speed don't matter.

    Raises
    ------
    RollerError
        If the settings are no good.
    """
    cell = VirtualCell(scan.changed(light={"speckle": 0.0}, scene={"text": _DOTS}).settings())
    middle = cell.truth.marks[len(cell.truth.marks) // 2]
    times = cell.truth.start_ros_ns + np.linspace(0, cell.truth.duration_ns, 2000).astype(np.int64)
    places = cell.truth.camera_positions(times)
    nearest = int(np.argmin(np.abs(places[:, 0] - middle.x)))
    log = np.log(np.maximum(cell.picture(int(times[nearest])), 1))
    pitch = DOT_PITCH_MM * 1e-3
    px = cell.camera.fx / cell.path.height_m
    half = int(pitch / 2 * px)
    found = []
    for dot in (d for d in range(6) if middle.mask >> d & 1):
        x, y = middle.x + (dot // 3 - 0.5) * pitch, middle.y + (1 - dot % 3) * pitch
        u = round(cell.camera.cx + (x - places[nearest, 0]) * px)
        v = round(cell.camera.cy - (y - places[nearest, 1]) * px)
        found.append(float(np.ptp(log[v - half : v + half + 1, u - half : u + half + 1])))
    return float(np.median(found))
