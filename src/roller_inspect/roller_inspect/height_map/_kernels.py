"""Triangles on the grid."""

from __future__ import annotations

import numba


@numba.njit(cache=True, nogil=True)
def _paint(corners, heights, low, high):  # type: ignore[no-untyped-def]
    """Take each triangle's lowest and highest corner into `low` and `high` of the cells in it.

    corners: int64 (n, 3, 2), row and column; heights: float32 (n, 3); low, high: float32 (ny, nx).
    Cells on an edge are in both triangles.
    """
    for n in range(len(corners)):
        y, x = corners[n, :, 0], corners[n, :, 1]
        area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
        if area == 0:
            continue
        turn = 1 if area > 0 else -1
        least, most = heights[n].min(), heights[n].max()
        for row in range(y.min(), y.max() + 1):
            first, last = x.min(), x.max()
            for a, b in ((0, 1), (1, 2), (2, 0)):
                # Inside an edge is where across + along * column >= 0.
                along = turn * (y[a] - y[b])
                across = turn * (x[b] - x[a]) * (row - y[a]) - along * x[a]
                if along > 0:
                    first = max(first, -(across // along))
                elif along < 0:
                    last = min(last, across // -along)
            for column in range(first, last + 1):
                low[row, column] = min(low[row, column], least)
                high[row, column] = max(high[row, column], most)
