"""Which points can be of the part that the others are of.

The map has memory for what lies between points: one that is metres from all others would take all
of it, or make the whole map coarse.
"""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64

from .height_map import Bools

#: No part has a place where nothing is seen for so long, m: along the scan, and across it as in
#: height.
ALONG_M, ACROSS_M = 5.0, 1.0


def main_body(points: F64) -> Bools:
    """Points that lie together, the most of them, of all that came so far.

    Parameters
    ----------
    points : ndarray, shape (3, n)
        Metres, finite, in any frame.
    """
    kept = np.ones(points.shape[1], np.bool_)
    with np.errstate(over="ignore"):
        if (np.ptp(points, axis=1) <= ACROSS_M).all():
            return kept
    while kept.any():
        before = np.count_nonzero(kept)
        for axis in points:
            low, high = _longest_run(np.sort(axis[kept]))
            kept &= (axis >= low) & (axis <= high)
        if np.count_nonzero(kept) == before:
            break
    return kept


def _longest_run(values: F64) -> tuple[float, float]:
    """First and last of the most values, in order, that have no wide gap between them."""
    with np.errstate(over="ignore"):
        gaps = np.flatnonzero(np.diff(values) > ACROSS_M)
    begins, ends = np.append(0, gaps + 1), np.append(gaps, len(values) - 1)
    k = int(np.argmax(ends - begins))
    return float(values[begins[k]]), float(values[ends[k]])


class PartExtent:
    """The box of a part so far, in the map's frame, and what can be of the part beside it."""

    def __init__(self) -> None:
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def take(self, points: F64) -> Bools | None:
        """Which points are of the part, of those that have come; the first ones all are.

        Parameters
        ----------
        points : ndarray, shape (3, n)
            Metres, finite, at least one.

        Returns
        -------
        ndarray of bool, shape (n,), or None
            None: all.
        """
        low, high = points.min(axis=1), points.max(axis=1)
        reach = np.array([ALONG_M, ACROSS_M, ACROSS_M])
        near = (low >= self._low - reach) & (high <= self._high + reach)
        kept: Bools | None = None
        if np.isfinite(self._low).all() and not near.all():
            kept = self._connected(points, reach)
            if not kept.any():
                return kept
            low, high = points[:, kept].min(axis=1), points[:, kept].max(axis=1)
        self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)
        return None if kept is None or kept.all() else kept

    def _connected(self, points: F64, reach: F64) -> Bools:
        """Points from which others lead to the box without a wide gap."""
        kept = np.ones(points.shape[1], np.bool_)
        while kept.any():
            before = np.count_nonzero(kept)
            for axis, low, high, most in zip(points, self._low, self._high, reach, strict=True):
                values = axis[kept]
                above = _end(high, np.sort(values[values > high]), most)
                below = -_end(-low, np.sort(-values[values < low]), most)
                kept &= (axis >= below) & (axis <= above)
            if np.count_nonzero(kept) == before:
                break
        return kept


def _end(begin: float, values: F64, most: float) -> float:
    """Last of some values in order, beyond a begin, up to the first wide gap."""
    with np.errstate(over="ignore"):
        gaps = np.flatnonzero(np.diff(values, prepend=begin) > most)
    reached = values[: gaps[0]] if len(gaps) else values
    return float(reached[-1]) if len(reached) else begin
