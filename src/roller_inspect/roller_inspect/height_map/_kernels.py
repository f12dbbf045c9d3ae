"""Triangles on the grid, and heights at the middles of its cells."""

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


@numba.njit(cache=True, nogil=True)
def _to_middles(h, height, place, most, out):  # type: ignore[no-untyped-def]
    """Write `height` less what the surface h rises from a cell's middle to `place` into `out`.

    h, height, out: float32 (ny, nx); place: float32 (2, ny, nx), along x and y, in cells. Beyond
    `most`, a cell's rise, slopes count no more. NaN stays.
    """
    ny, nx = h.shape
    for i in range(ny):
        above, below = max(i - 1, 0), min(i + 1, ny - 1)
        for j in range(nx):
            left, right = max(j - 1, 0), min(j + 1, nx - 1)
            along = (h[i, right] - h[i, left]) / max(right - left, 1)
            across = (h[below, j] - h[above, j]) / max(below - above, 1)
            along, across = min(max(along, -most), most), min(max(across, -most), most)
            out[i, j] = height[i, j] - (along * place[0, i, j] + across * place[1, i, j])
