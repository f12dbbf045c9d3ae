"""The nearest points of a cloud that lies along a surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from . import _near_kernels as kernels

I64 = npt.NDArray[np.int64]

#: Cells along each axis at most.
_MOST_CELLS = 1000


def bounds(points: F64) -> tuple[F64, F64]:
    """Least and most of each coordinate of points, shape (n, 3), n > 0, along an axis each."""
    low, high = np.empty(3), np.empty(3)
    kernels._bounds(np.ascontiguousarray(points), low, high)
    return low, high


class NearCloud:
    """Finds the nearest of some points by a grid over the two axes along which they lie apart.

    For points of a surface, not far from those asked for, that is a fraction of what a tree takes:
    it is made by counting, and what is asked for lies in a few cells.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 3)
        Metres, n > 0.
    edge_m : float
        Edge of a cell, about as far as is looked, metres.
    """

    def __init__(self, points: F64, edge_m: float) -> None:
        self.points = np.ascontiguousarray(points)
        low, high = bounds(self.points)
        axes = np.sort(np.argsort(high - low)[1:])
        span = (high - low)[axes]
        self._axes = int(axes[0]), int(axes[1])
        self._least = float(low[axes[0]]), float(low[axes[1]])
        self._edge = max(edge_m, float(span.max()) / _MOST_CELLS)
        rows, columns = (span / self._edge).astype(np.int64) + 1
        self._starts = np.zeros((rows, columns + 1), np.int64)
        self._order = np.empty(len(points), np.int64)
        kernels._sort(self.points, self._axes, self._least, self._edge, self._starts, self._order)

    def nearest(self, places: F64, count: int, most_m: float) -> tuple[F64, I64]:
        """The nearest points to each of some places.

        Parameters
        ----------
        places : ndarray of float64, shape (m, 3)
            Metres.
        count : int
            Points for each.
        most_m : float
            Points as far as this, or further, aren't taken, metres.

        Returns
        -------
        away : ndarray of float64, shape (m, count)
            Distances, growing; infinite where there are fewer.
        number : ndarray of int64, shape (m, count)
            Of the points; n where there are fewer.
        """
        away, number = np.empty((len(places), count)), np.empty((len(places), count), np.int64)
        kernels._nearest(
            self.points, self._starts, self._order, self._axes, self._least, self._edge,
            np.ascontiguousarray(places), most_m, away, number,
        )  # fmt: skip
        return away, number
