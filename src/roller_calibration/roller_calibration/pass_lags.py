"""How far the maps of a scan's two passes lie apart, by stretches of alike speeds."""

from __future__ import annotations

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
#: Stretches whose speeds differ by more than this ratio are judged apart.
_ALIKE = 1.25
#: Largest delay, of either sign, that is looked for, s.
MOST_S = 0.02
#: A lag is no better than this share of a pixel, however well strips agree.
_FINEST_PX = 0.1


@dataclass(frozen=True)
class Lag:
    """How far the forward pass's map lies ahead over a stretch of alike speeds."""

    lag_m: float
    #: Its standard error by the scatter of strips of the image.
    deviation_m: float
    #: Speed of the one pass plus that of the other.
    closing_m_s: float
    events: int


def lags_of(
    scan: Scan, course: Course, depth_m: float, delay_s: float, reach_px: int | None
) -> list[Lag]:
    """Lags of a scan's stretches of alike speeds.

    Parameters
    ----------
    scan, course : Scan, Course
        A scan that goes to and fro, and its path.
    depth_m : float
        Depth of the surface, metres.
    delay_s : float
        What event stamps are taken to lag the poses by, seconds.
    reach_px : int, optional
        Furthest lag looked for, px; None: what a delay of `MOST_S` gives.

    Raises
    ------
    TimeOffsetError
        If the passes share too little of the path, agree nowhere, or at several places alike.
    """
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
        lag = _compare([(a, b * own) for a, b in maps], pixel_m, speed, reach_px)
        if lag is not None:
            found.append(Lag(*lag, speed, events))
    if not found:
        raise TimeOffsetError(
            "the two passes agree nowhere: too little relief, or an offset beyond "
            f"±{MOST_S * 1e3:g} ms"
        )
    return found


def _compare(
    maps: list[tuple[F64, F64]], pixel_m: float, closing_m_s: float, reach_px: int | None
) -> tuple[float, float] | None:
    """Lag and its standard error, metres; None where the maps don't agree."""
    shape = maps[0][0].shape
    longest = int(np.ceil(MOST_S * closing_m_s / pixel_m)) + 8
    reach = min(longest if reach_px is None else reach_px, shape[1] // 2 - 1)
    total = np.zeros((shape[0], 2 * reach + 1))
    energy = np.zeros(2)
    for a, b in maps:
        energy += (np.square(a)[:, b.any(axis=0)].sum(), np.square(b).sum())
        total += _correlate(a, b, reach)
    summed = total.sum(axis=0)
    best = int(np.argmax(summed))
    if reach_px is not None and best in (0, 2 * reach):
        return None
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
