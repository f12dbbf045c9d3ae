"""How far event stamps lag the robot's poses, from scans that go to and fro.

An event stamped `delay` too late is put `delay` times the speed too far along the path. Going
back over the same place it is put too far the other direction. What brightens a pixel going there
darkens it coming back: ON events of one pass are compared with OFF events of the other.

A pixel fires when brightness has changed by its threshold, which is past the middle of a soft
edge, from either side. That lag is a length, not a time. So the passes' maps lie

    lag = 2 · late + (forward + backward speed) · delay

apart, and two speeds separate the two: those of two scans, or of a ramp and a steady
stretch of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from .bidirectional import (
    LEAST_EVENTS,
    LEAST_TRAVEL_M,
    Course,
    Pass,
    TimeOffsetError,
    closing_speed,
    course_of,
    passes_of,
)
from .recordings import Scan

I64 = npt.NDArray[np.int64]

#: Rows of the maps are this many pixels, and strips of rows are judged each for itself.
_ROW_PX, _STRIPS = 4, 8
#: Structures wider than this don't count, px.
_WIDE_PX = 20.0
#: Least correlation of the two passes, and share of it that a second place may reach.
_LEAST_CORRELATION, _MOST_RIVAL = 0.1, 0.9
#: Stretches whose speeds differ by more than this ratio are judged apart; and the ratio from
#: which a travel can be distinguished from a time.
_ALIKE, _APART = 1.25, 1.5
_ROUNDS = 6
#: Largest delay, of either sign, that is looked for, s.
_MOST_S = 0.02
#: How far edges lag by themselves, metres: what one speed leaves unknown.
_EDGE_LAG_M = 1e-4
#: A lag is no better than this share of a pixel, however well strips agree.
_FINEST_PX = 0.1


@dataclass(frozen=True)
class TimeOffset:
    """What was found."""

    #: Event stamps less the time, in the clock of the poses, of what they show, seconds.
    delay_s: float
    #: Standard error by the scatter of strips of the image, seconds; where one speed can't show
    #: what edges lag by, that too.
    deviation_s: float
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
    delay_s = 0.0
    for _ in range(_ROUNDS):
        lags = [
            lag
            for scan, course in zip(scans, courses, strict=True)
            for lag in _lags(scan, course, depth_m, delay_s)
        ]
        closing = np.array([lag.closing_m_s for lag in lags])
        apart = closing.max() / closing.min() >= _APART
        weight = 1.0 / np.array([lag.deviation_m for lag in lags])
        terms = np.column_stack([closing, np.ones(len(lags))] if apart else [closing])
        design, target = terms * weight[:, None], np.array([g.lag_m for g in lags]) * weight
        solution, *_ = np.linalg.lstsq(design, target, rcond=None)
        delay_s += float(solution[0])
        if abs(delay_s) > _MOST_S:
            raise TimeOffsetError(
                f"no offset within ±{_MOST_S * 1e3:g} ms makes the passes agree; are poses and "
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
        float(solution[1]) / 2 if apart else None,
        tuple(float(c) / 2 for c in np.sort(closing)),
        sum(lag.events for lag in lags),
    )


@dataclass(frozen=True)
class _Lag:
    """How far the forward pass's map lies ahead over a stretch of alike speeds."""

    lag_m: float
    deviation_m: float
    closing_m_s: float
    events: int


def _lags(scan: Scan, course: Course, depth_m: float, delay_s: float) -> list[_Lag]:
    """Lags of a scan's stretches."""
    forward, back = passes_of(scan, course, depth_m, delay_s)
    pixel_m = depth_m / scan.camera.fx
    low = max(forward.along_m.min(), back.along_m.min())
    high = min(forward.along_m.max(), back.along_m.max())
    if high - low < LEAST_TRAVEL_M:
        raise TimeOffsetError(
            f"the two passes share {max(high - low, 0) * 1e3:.1f} mm of the path, less than "
            f"{LEAST_TRAVEL_M * 1e3:g} mm: roll back over the same place"
        )
    top = min(forward.across_m.min(), back.across_m.min())
    bottom = max(forward.across_m.max(), back.across_m.max())
    shape = (int((bottom - top) / (pixel_m * _ROW_PX)) + 1, int((high - low) / pixel_m) + 1)
    maps = [
        (
            _map(forward, on, (low, top), pixel_m, shape),
            _map(back, not on, (low, top), pixel_m, shape),
        )
        for on in (True, False)
    ]
    closing = closing_speed(course, low + (np.arange(shape[1]) + 0.5) * pixel_m)
    counts = np.histogram(
        np.concatenate([forward.along_m, back.along_m]), shape[1], (low, low + shape[1] * pixel_m)
    )[0]
    found = []
    level = np.floor(np.log(np.maximum(closing, 1e-6)) / np.log(_ALIKE))
    for k in np.unique(level[closing > 0]):
        own = level == k
        events = int(counts[own].sum())
        if own.sum() * pixel_m < LEAST_TRAVEL_M / 2 or events < 2 * LEAST_EVENTS:
            continue
        speed = float(np.average(closing[own], weights=counts[own]))
        lag = _compare([(a, b * own) for a, b in maps], pixel_m, speed)
        if lag is not None:
            found.append(_Lag(*lag, speed, events))
    if not found:
        raise TimeOffsetError(
            "the two passes agree nowhere: too little relief, or an offset beyond "
            f"±{_MOST_S * 1e3:g} ms"
        )
    return found


def _compare(
    maps: list[tuple[F64, F64]], pixel_m: float, closing_m_s: float
) -> tuple[float, float] | None:
    """Lag and its standard error, metres; None where the maps don't agree."""
    shape = maps[0][0].shape
    reach = min(int(np.ceil(_MOST_S * closing_m_s / pixel_m)) + 8, shape[1] // 2 - 1)
    total = np.zeros((shape[0], 2 * reach + 1))
    energy = np.zeros(2)
    for a, b in maps:
        energy += (np.square(a)[:, b.any(axis=0)].sum(), np.square(b).sum())
        total += _correlate(a, b, reach)
    summed = total.sum(axis=0)
    best = int(np.argmax(summed))
    if summed[best] < _LEAST_CORRELATION * np.sqrt(energy.prod()):
        return None
    rivals = _tops(summed)
    rivals = rivals[np.abs(rivals - best) > 5]
    if len(rivals) and summed[rivals].max() > _MOST_RIVAL * summed[best]:
        other = int(rivals[np.argmax(summed[rivals])])
        raise TimeOffsetError(
            f"the relief repeats: offsets {abs(other - best) * pixel_m / closing_m_s * 1e3:.1f} "
            "ms apart fit alike; roll over a surface that doesn't repeat"
        )
    near = slice(max(best - 4, 0), best + 5)
    found = []
    for strip in np.array_split(total, min(_STRIPS, shape[0])):
        values = strip.sum(axis=0)
        if values[near].max() > 0.02 * summed[best]:
            k = near.start + int(np.argmax(values[near]))
            found.append(k + _between(values, k))
    scatter = np.std(found, ddof=1) / np.sqrt(len(found)) if len(found) > 1 else 1.0
    deviation_px = float(np.hypot(scatter, _FINEST_PX))
    return (best + _between(summed, best) - reach) * pixel_m, deviation_px * pixel_m


def _map(
    one: Pass, on: bool, origin: tuple[float, float], pixel_m: float, shape: tuple[int, int]
) -> F64:
    """Events on the surface, shared by the two nearest columns; narrow structures alone."""
    own = one.on == on
    x = (one.along_m[own] - origin[0]) / pixel_m
    row = ((one.across_m[own] - origin[1]) / (pixel_m * _ROW_PX)).astype(np.int64)
    column = np.floor(x).astype(np.int64)
    part = x - column
    counts = np.zeros(shape[0] * shape[1])
    for k, weight in ((column, 1 - part), (column + 1, part)):
        good = (k >= 0) & (k < shape[1]) & (row >= 0) & (row < shape[0])
        counts += np.bincount(row[good] * shape[1] + k[good], weight[good], len(counts))
    image = np.sqrt(counts.reshape(shape))
    fine = cv2.GaussianBlur(image, (0, 0), sigmaX=1.5, sigmaY=0.5)
    return np.asarray(fine - cv2.GaussianBlur(image, (0, 0), sigmaX=_WIDE_PX, sigmaY=0.5))


def _correlate(a: F64, b: F64, reach: int) -> F64:
    """Row by row sum of a(x + lag) · b(x) for lags from -reach to reach."""
    size = 1 << int(np.ceil(np.log2(a.shape[1] + reach + 1)))
    product = np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size))
    all_lags = np.fft.irfft(product, size)
    return np.asarray(np.concatenate([all_lags[:, -reach:], all_lags[:, : reach + 1]], axis=1))


def _tops(values: F64) -> I64:
    """Places higher than both neighbours."""
    inner = (values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])
    return np.flatnonzero(inner) + 1


def _between(values: F64, k: int) -> float:
    """Top of the parabola through a place and its neighbours, from the place."""
    if not 0 < k < len(values) - 1:
        return 0.0
    bend = values[k - 1] - 2 * values[k] + values[k + 1]
    return float(0.5 * (values[k - 1] - values[k + 1]) / bend) if bend < 0 else 0.0
