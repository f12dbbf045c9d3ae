"""Depth bounds from the window before, given up as soon as they don't fit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .rays import F32

#: Least number of depths that bounds are taken from.
_ENOUGH = 200
#: Share of depths next to a bound from which on it may cut off others.
_AT_END = 0.02


class DepthPrior:
    """Remembers which depths a scene needs.

    Parameters
    ----------
    range_m : tuple of float
        Nearest and farthest depth that may be, metres.
    margin_m : float
        How far beyond the last depths to look; 0 always looks at the whole range.
    """

    def __init__(self, range_m: tuple[float, float], margin_m: float) -> None:
        self._range = range_m
        self._margin = margin_m
        self._bounds = range_m

    def tries(self) -> Iterator[tuple[float, float]]:
        """Bounds to search, metres: narrow ones first, if there are, then the whole range."""
        if self._bounds != self._range:
            yield self._bounds
        yield self._range

    def accepts(self, depth: F32, bounds: tuple[float, float]) -> bool:
        """Whether a depth map may stand; the next bounds come from it.

        Parameters
        ----------
        depth : ndarray of float32, shape (height, width)
            Metres, NaN = not measured.
        bounds : tuple of float
            What it was searched in.
        """
        if self._margin == 0:
            return True
        known = depth[np.isfinite(depth)]
        low, high = self._range
        if len(known) < _ENOUGH:
            self._bounds = self._range
            return bounds == self._range
        edge = 0.25 * self._margin
        near_end = ((known < bounds[0] + edge) & (bounds[0] > low)) | (
            (known > bounds[1] - edge) & (bounds[1] < high)
        )
        if near_end.mean() > _AT_END:
            self._bounds = self._range
            return False
        first, last = np.percentile(known, [0.5, 99.5])
        self._bounds = (max(first - self._margin, low), min(last + self._margin, high))
        return True
