"""The part of a pass that is rolled at one speed.

Where the roller speeds up, a delay of the event stamps that isn't known yet scales depth by
acceleration × delay / speed: 0.4 ms at 15 m/s² and 0.3 m/s are 1 mm of 45. And between two poses
the path is taken as straight, which puts a track of 125 Hz off by 0.1 mm at 15 m/s².
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roller_core.errors import RollerError
from roller_core.pose_track import PoseTrack

from .recordings import Scan

#: Steps of time, and half the span over which a speed is taken (poses carry noise), ns.
_STEP_NS, _HALF_SPAN_NS = 2_000_000, 10_000_000
#: Speeds count from this share of the highest, as the way home may be much faster, and may differ
#: by this share to either side; and the steps (of their logarithm) in which speeds are tried.
_MOVING, _UNEVEN, _FINE = 0.01, 0.05, 0.02
#: A part counts if it has this share of the events per metre of the one with most; in the air, on
#: the way back, there are only those of noise.
_LEAST_SHARE = 0.25


class SpeedError(RollerError):
    """A pass without a part at one speed."""


def constant_speed_part(scan: Scan, least_m: float) -> Scan:
    """Leave out the events of ramps and standstill.

    Parameters
    ----------
    scan : Scan
        The pass.
    least_m : float
        Travel that the part must have, metres.

    Returns
    -------
    Scan
        With the events of the longest path on the surface whose speed stays within a twentieth of
        some speed.

    Raises
    ------
    SpeedError
        If that part is too short.
    """
    track = scan.track
    first, last = track.start_ns + _HALF_SPAN_NS, track.end_ns - _HALF_SPAN_NS
    times = np.arange(first, last + 1, _STEP_NS, dtype=np.int64)
    parts, length_m = np.empty((0, 2), np.int64), 0.0
    if len(times):
        ends = [track.sample(times + side * _HALF_SPAN_NS)[0] for side in (-1, 1)]
        speed = np.linalg.norm(ends[1] - ends[0], axis=1) / (2e-9 * _HALF_SPAN_NS)
        travel = np.concatenate([[0.0], np.cumsum(speed)]) * _STEP_NS * 1e-9
        # Each speed that occurs, in steps finer than what may differ.
        moving = np.log(speed[speed > _MOVING * speed.max()])
        for usual in np.exp(np.unique(np.rint(moving / _FINE)) * _FINE):
            even = np.abs(speed - usual) <= _UNEVEN * usual
            edges = np.flatnonzero(np.diff(np.concatenate([[False], even, [False]])))
            found = edges.reshape(-1, 2)
            lengths = travel[found[:, 1]] - travel[found[:, 0]]
            length_m = max(length_m, float(lengths.max(initial=0.0)))
            parts = np.concatenate([parts, found[lengths >= least_m]])
    if not len(parts):
        raise SpeedError(
            f"{scan.name}: {length_m * 1e3:.1f} mm at one speed, less than {least_m * 1e3:g} mm: "
            "roll at a steady speed, without stops"
        )
    lengths = travel[parts[:, 1]] - travel[parts[:, 0]]
    cuts = np.searchsorted(scan.events.t_ns, times[parts - [0, 1]])
    density = np.diff(cuts, axis=1)[:, 0] / lengths
    lengths[density < _LEAST_SHARE * density.max()] = 0
    begin, end = cuts[np.argmax(lengths)]
    return replace(scan, events=scan.events[int(begin) : int(end)])


def rolling_speed_m_s(track: PoseTrack) -> float:
    """Speed at which most of the way was rolled."""
    steps = np.linalg.norm(np.diff(track.positions, axis=0), axis=1)
    speeds = steps / np.maximum(np.diff(track.times_ns) * 1e-9, 1e-6)
    order = np.argsort(speeds)
    way = np.cumsum(steps[order])
    return float(speeds[order][np.searchsorted(way, 0.5 * way[-1])])
