"""Points and triangles on the grid, and heights at the middles of its cells."""

from __future__ import annotations

import numba
import numpy as np


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


@numba.njit(cache=True, nogil=True)
def _bin(x, y, height, sigma, least, shared, sums, out, place, count):  # type: ignore[no-untyped-def]
    """Write means of points by cell, weighted by 1 / sigma², and their uncertainty.

    x, y, height, sigma: float64 (n,), places in cells; sums: float64 (ny, nx, 4), scratch; out:
    float32 (2, ny, nx), mean and uncertainty, NaN without points; place: float32 (2, ny, nx), mean
    of x and y from the cell's middle; count: uint16 (ny, nx). No sigma is below `least`; `shared`
    points count as one.
    """
    ny, nx = count.shape
    sums[:], count[:] = 0.0, 0
    for k in range(len(x)):
        column, row = int(np.floor(x[k])), int(np.floor(y[k]))
        if column < 0 or row < 0 or column >= nx or row >= ny:
            continue
        weight = 1.0 / max(sigma[k], least) ** 2
        own = sums[row, column]
        own[0] += weight
        own[1] += weight * height[k]
        own[2] += weight * (x[k] - column - 0.5)
        own[3] += weight * (y[k] - row - 0.5)
        if count[row, column] < 65535:
            count[row, column] += 1
    for row in range(ny):
        for column in range(nx):
            n, own = float(count[row, column]), sums[row, column]
            if n == 0:
                out[:, row, column], place[:, row, column] = np.nan, 0.0
                continue
            out[0, row, column] = own[1] / own[0]
            # Points of one cell see the same events: their mean is hardly better than one of them.
            out[1, row, column] = np.sqrt(n / own[0] / (1.0 + (n - 1.0) / shared))
            place[0, row, column], place[1, row, column] = own[2] / own[0], own[3] / own[0]
