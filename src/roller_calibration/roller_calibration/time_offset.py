"""How far event stamps lag the robot's poses, from scans that go to and fro.

An event stamped `delay` too late is put `delay` times the speed too far along the path. Going
back over the same place it is put too far the other direction. What brightens a pixel going there
darkens it coming back: ON events of one pass are compared with OFF events of the other.

A pixel fires when brightness has changed by its threshold, which is past the middle of a soft
edge, from either side. That lag is a length, not a time. So the passes' maps lie

    lag = 2 · late + (forward + backward speed) · delay

apart, and two speeds separate the two: those of two scans, or of a ramp and a steady
stretch of one.

After an event a pixel is blind for some time, and what changes meanwhile it never tells: its next
event comes earlier or later by a travel that goes with the speed, as a delay does. That is least
where a bright and a dark edge follow each other closely, as in a texture: where such do, they alone
count. How far it still is hangs on the relief, so part of the blind time counts as uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .bidirectional import Course, TimeOffsetError, by_pixel, close_edges, course_of
from .pass_lags import MOST_S, lags_of
from .recordings import Scan

#: Ratio of speeds from which a travel can be distinguished from a time.
_APART = 1.5
_ROUNDS = 6
#: How far edges lag by themselves, metres: what one speed leaves unknown.
_EDGE_LAG_M = 1e-4
#: Edges of either polarity closer than this are preferred, metres; and how far, px, their lag may
#: be from that of all events.
_CLOSE_M, _CLOSE_REACH_PX = 3e-4, 6
#: Intervals between a pixel's events longer than this don't tell how long it is blind, s; and so
#: much of all intervals may be shorter than that time, by noise.
_LONGEST_BLIND_S, _NOISE_SHARE = 1e-3, 1e-4
#: Share of the blind time that may be taken for delay, by close edges and by all events (RMS
#: over scans of all kinds by two simulators).
_BLIND_SHARE_CLOSE, _BLIND_SHARE = 0.15, 0.25


@dataclass(frozen=True)
class TimeOffset:
    """What was found."""

    #: Event stamps less the time, in the clock of the poses, of what they show, seconds.
    delay_s: float
    #: Standard error, seconds: by the scatter of strips of the image, by how long pixels are
    #: blind, and where one speed can't show what edges lag by, by that.
    deviation_s: float
    #: A pixel's shortest interval between events, seconds: it is blind for no longer than that.
    #: 0 where none is short enough to tell.
    blind_s: float
    #: Travel past an edge at which its events come, metres; None where one speed can't show it:
    #: then the delay holds it too.
    late_m: float | None
    #: Mean speeds that were compared, m/s.
    speeds_m_s: tuple[float, ...]
    #: Events that counted.
    events: int


def estimate_time_offset(scans: Sequence[Scan], depth_m: float) -> TimeOffset:
    """Delay of event stamps against poses from scans that reverse.

    Parameters
    ----------
    scans : sequence of Scan
        At least one; at two speeds, or one with long ramps, for a delay free of what edges lag.
    depth_m : float
        Depth of the surface, metres; relief of a millimetre does no harm.

    Raises
    ------
    TimeOffsetError
        If a scan doesn't go to and fro over the same place, or there is too little to compare.
    """
    courses = [course_of(scan) for scan in scans]
    found, share = _solve(scans, courses, depth_m, 0.0, None), _BLIND_SHARE
    close = [
        replace(scan, events=close_edges(scan, course, _CLOSE_M))
        for scan, course in zip(scans, courses, strict=True)
    ]
    try:
        lines = _solve(close, courses, depth_m, found.delay_s, _CLOSE_REACH_PX)
        if (lines.late_m is None) == (found.late_m is None):
            found, share = lines, _BLIND_SHARE_CLOSE
    except TimeOffsetError:
        pass  # too few of them: all events tell more
    blind_s = min(filter(None, map(_blind_time, scans)), default=0.0)
    deviation_s = float(np.hypot(found.deviation_s, share * blind_s))
    return replace(found, deviation_s=deviation_s, blind_s=blind_s)


def _solve(
    scans: Sequence[Scan],
    courses: Sequence[Course],
    depth_m: float,
    delay_s: float,
    reach_px: int | None,
) -> TimeOffset:
    """Delay by all events of scans, from a first guess on; see `lags_of` for `reach_px`."""
    for _ in range(_ROUNDS):
        lags = [
            lag
            for scan, course in zip(scans, courses, strict=True)
            for lag in lags_of(scan, course, depth_m, delay_s, reach_px)
        ]
        closing = np.array([lag.closing_m_s for lag in lags])
        apart = closing.max() / closing.min() >= _APART
        weight = 1.0 / np.array([lag.deviation_m for lag in lags])
        terms = np.column_stack([closing, np.ones(len(lags))] if apart else [closing])
        design, target = terms * weight[:, None], np.array([g.lag_m for g in lags]) * weight
        solution, *_ = np.linalg.lstsq(design, target, rcond=None)
        delay_s += float(solution[0])
        if abs(delay_s) > MOST_S:
            raise TimeOffsetError(
                f"no offset within ±{MOST_S * 1e3:g} ms makes the passes agree; are poses and "
                "events of the same clock?"
            )
    # Larger than strips of the image say where the stretches themselves don't agree.
    rest = target - design @ solution
    spread = np.sqrt((rest @ rest) / max(len(lags) - len(solution), 1)) if len(lags) > 2 else 1.0
    deviation = float(np.sqrt(np.linalg.inv(design.T @ design)[0, 0])) * max(float(spread), 1.0)
    if not apart:
        deviation = float(np.hypot(deviation, 2 * _EDGE_LAG_M / closing.mean()))
    return TimeOffset(
        delay_s,
        deviation,
        0.0,
        float(solution[1]) / 2 if apart else None,
        tuple(float(c) / 2 for c in np.sort(closing)),
        sum(lag.events for lag in lags),
    )


def _blind_time(scan: Scan) -> float:
    """Shortest interval between two events of a pixel, seconds; 0 where all are long."""
    order, same = by_pixel(scan)
    intervals = np.diff(scan.events.t_ns[order])[same]
    if not len(intervals):
        return 0.0
    shortest = float(np.quantile(intervals, _NOISE_SHARE)) * 1e-9
    return shortest if shortest <= _LONGEST_BLIND_S else 0.0
