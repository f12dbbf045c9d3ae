"""Conjugate gradients for the completion of the surface, without forming the matrix.

Arrays are C-ordered and all of one type: float64, or float32, which takes less time. `_apply` is
the matrix of `completion`'s quadratic form.
"""

from __future__ import annotations

import numba
import numpy as np

#: Sums may be reordered; nothing here is NaN or infinite.
_SUMS = {"reassoc", "contract", "nsz"}


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _apply(h, pull, bend, tie_x, tie_y, lines, out):  # type: ignore[no-untyped-def]
    """Write A h into `out` (ny, nx); `lines` (3, nx + 2) is scratch.

    A is diagonal `pull` (ny, nx), plus second differences weighted by `bend` (ny, nx) of the
    middle cell (twice for the mixed one, of the cell with the lowest indices), plus first
    differences weighted by `tie_x` (ny, nx - 1) and `tie_y` (ny - 1, nx). Each loop writes one
    row, so that it runs on several cells at once.
    """
    ny, nx = h.shape
    lines[:] = 0
    # Of a row: its second differences, and what flows from each cell to the next; mixed ones.
    second, flow, mixed = lines[0], lines[1], lines[2]
    out[0] = 0
    for i in range(ny):
        here, w, own = h[i], bend[i], out[i]
        second[1], second[nx] = 0, 0
        for j in range(1, nx - 1):
            second[j + 1] = w[j] * (here[j - 1] - here[j] + (here[j + 1] - here[j]))
        for j in range(nx - 1):
            flow[j + 1] = tie_x[i, j] * (here[j + 1] - here[j]) + second[j + 1] - second[j + 2]
        for j in range(nx):
            own[j] += pull[i, j] * here[j] + flow[j] - flow[j + 1]
        if i == ny - 1:
            continue
        below, under = h[i + 1], out[i + 1]
        for j in range(nx - 1):
            mixed[j + 1] = (w[j] + w[j]) * (here[j] - here[j + 1] - below[j] + below[j + 1])
        for j in range(nx):
            under[j] = mixed[j] - mixed[j + 1] + tie_y[i, j] * (below[j] - here[j])
        for j in range(nx):
            own[j] -= under[j]
        if i > 0:
            above, over = h[i - 1], out[i - 1]
            for j in range(nx):
                second[j] = w[j] * (above[j] - here[j] + (below[j] - here[j]))
            for j in range(nx):
                over[j] += second[j]
            for j in range(nx):
                own[j] -= second[j] + second[j]
            for j in range(nx):
                under[j] += second[j]
            second[0] = 0


@numba.njit(cache=True, nogil=True)
def _diagonal(pull, bend, tie_x, tie_y, out):  # type: ignore[no-untyped-def]
    """Write the diagonal of the matrix into `out` (ny, nx)."""
    ny, nx = pull.shape
    for i in range(ny):
        for j in range(nx):
            out[i, j] = pull[i, j]
    for i in range(ny):
        for j in range(nx):
            w = bend[i, j]
            if 0 < j < nx - 1:
                out[i, j - 1] += w
                out[i, j] += 4 * w
                out[i, j + 1] += w
            if 0 < i < ny - 1:
                out[i - 1, j] += w
                out[i, j] += 4 * w
                out[i + 1, j] += w
            if j < nx - 1:
                out[i, j] += tie_x[i, j]
                out[i, j + 1] += tie_x[i, j]
                if i < ny - 1:
                    out[i, j] += 2 * w
                    out[i, j + 1] += 2 * w
                    out[i + 1, j] += 2 * w
                    out[i + 1, j + 1] += 2 * w
            if i < ny - 1:
                out[i, j] += tie_y[i, j]
                out[i + 1, j] += tie_y[i, j]


@numba.njit(cache=True, nogil=True, fastmath=_SUMS)
def _solve(h, right, pull, bend, tie_x, tie_y, tolerance, steps, work):  # type: ignore[no-untyped-def]
    """Solve A h = right in place from a start; `work` (5, ny, nx). Returns the steps taken."""
    ny, nx = h.shape
    residual, turned, way, image, scale = work[0], work[1], work[2], work[3], work[4]
    lines = np.empty((3, nx + 2), h.dtype)
    _diagonal(pull, bend, tie_x, tie_y, scale)
    _apply(h, pull, bend, tie_x, tie_y, lines, image)
    rho, norm = h.dtype.type(0), h.dtype.type(0)
    for i in range(ny):
        for j in range(nx):
            scale[i, j] = 1 / scale[i, j]
            residual[i, j] = right[i, j] - image[i, j]
            turned[i, j] = residual[i, j] * scale[i, j]
            way[i, j] = turned[i, j]
            rho += residual[i, j] * turned[i, j]
            norm += right[i, j] * right[i, j] * scale[i, j]
    for step in range(steps):
        if rho <= tolerance * tolerance * norm or rho == 0:
            return step
        _apply(way, pull, bend, tie_x, tie_y, lines, image)
        lift = h.dtype.type(0)
        for i in range(ny):
            for j in range(nx):
                lift += way[i, j] * image[i, j]
        if lift <= 0:
            return step
        alpha, before = rho / lift, rho
        rho = h.dtype.type(0)
        for i in range(ny):
            for j in range(nx):
                h[i, j] += alpha * way[i, j]
                residual[i, j] -= alpha * image[i, j]
                turned[i, j] = residual[i, j] * scale[i, j]
                rho += residual[i, j] * turned[i, j]
        beta = rho / before
        for i in range(ny):
            for j in range(nx):
                way[i, j] = turned[i, j] + beta * way[i, j]
    return steps


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
