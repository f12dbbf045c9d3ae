"""Profiles between two points, and what they show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import CONTINUED, MEASURED, OUTSIDE, U8, Bools, HeightMap

from .measured import STANDS_OUT, Measured, not_measurable

#: Share of a profile, at either end, that its datum line goes through.
_ENDS = 0.2
_LEAST_KNOWN = 0.8


@dataclass(frozen=True)
class Profile:
    """Heights along a line on the surface."""

    #: From the first point. Shape (n,).
    distance_m: F64
    #: Metres; NaN where there is none. Shape (n,).
    height_m: F64
    sigma_m: F64
    #: Of the nearest cell. Shape (n,).
    state: U8


def profile(
    height_map: HeightMap, start_m: tuple[float, float], end_m: tuple[float, float]
) -> Profile:
    """Profile between two points, given in the map's frame, metres."""
    step = height_map.step_m
    length = float(np.hypot(end_m[0] - start_m[0], end_m[1] - start_m[1]))
    distance = np.linspace(0.0, length, max(2, round(length / step) + 1))
    share = distance / max(length, 1e-12)
    x = start_m[0] + share * (end_m[0] - start_m[0])
    y = start_m[1] + share * (end_m[1] - start_m[1])
    at = np.stack([(y - height_map.y_m[0]) / step, (x - height_map.x_m[0]) / step])
    limit = np.array(height_map.shape)[:, None] - 0.5
    inside = ((at >= -0.5) & (at <= limit)).all(axis=0)
    nearest = ndimage.map_coordinates(height_map.state, at, order=0, mode="nearest")
    height, sigma = (
        ndimage.map_coordinates(grid, at, order=1, mode="nearest", output=np.float64)
        for grid in (height_map.height_m, height_map.sigma_m)
    )
    return Profile(
        distance,
        np.where(inside, height, np.nan),
        np.where(inside, sigma, np.nan),
        np.where(inside, nearest, OUTSIDE).astype(np.uint8),
    )


def width_and_depth(found: Profile) -> tuple[Measured, Measured]:
    """Width at half depth, and depth, of what a profile crosses; of + a rise, − a hollow.

    Its datum is the line through both ends.
    """
    known = (found.state >= CONTINUED) & np.isfinite(found.height_m)
    n = len(known)
    ends = np.zeros(n, bool)
    ends[: max(2, round(_ENDS * n))] = ends[-max(2, round(_ENDS * n)) :] = True
    if known.mean() < _LEAST_KNOWN or (known & ends).sum() < 4:
        reason = "too much of the profile was not measured"
        return not_measurable("m", reason), not_measurable("m", reason)
    line = np.polyfit(found.distance_m[known & ends], found.height_m[known & ends], 1)
    away = np.where(known, found.height_m - np.polyval(line, found.distance_m), 0.0)
    sigma = float(np.median(found.sigma_m[known]))
    middle = np.where(ends, 0.0, away)
    k = int(np.argmax(np.abs(middle)))
    depth = float(np.median(away[max(k - 1, 0) : k + 2]))
    u_depth = float(np.hypot(sigma, sigma / np.sqrt(2)))
    if abs(depth) <= STANDS_OUT * u_depth:
        return not_measurable("m", "nothing stands out of the noise"), Measured(
            depth, STANDS_OUT * u_depth, "m"
        )
    over = away * np.sign(depth) > abs(depth) / 2
    low, high = k, k
    while low > 0 and over[low - 1]:
        low -= 1
    while high < n - 1 and over[high + 1]:
        high += 1
    step = float(found.distance_m[1] - found.distance_m[0])
    signed, level = away * np.sign(depth), abs(depth) / 2
    edges = [_crossing(signed, low, -1, level), _crossing(signed, high, 1, level)]
    slope = float(np.abs(np.gradient(away, step)).max())
    apart = [_apart(found.state == MEASURED, edge) * step for edge in edges]
    u_width = math.hypot(
        *(math.hypot(sigma / max(slope, 1e-3), gap / math.sqrt(12)) for gap in apart)
    )
    width = (edges[1] - edges[0]) * step
    return Measured(width, 2 * u_width, "m"), Measured(depth, 2 * u_depth, "m")


def _apart(measured: Bools, at: float) -> float:
    """How far the measured cells on either side of a place lie apart, cells; at least 1.

    In between the surface was continued: an edge may run anywhere there.
    """
    places = np.flatnonzero(measured)
    k = int(np.searchsorted(places, at))
    below = places[k - 1] if k else -1
    above = places[k] if k < len(places) else len(measured)
    return float(max(above - below, 1))


def _crossing(values: F64, at: int, way: int, level: float) -> float:
    """Where a value falls below a level, between a cell and the next."""
    beside = at + way
    if not 0 <= beside < len(values) or values[at] == values[beside]:
        return float(at)
    return at + way * float((values[at] - level) / (values[at] - values[beside]))
