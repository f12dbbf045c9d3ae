"""Loops over height maps; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(height, x, y, x0, y0, step, out):  # type: ignore[no-untyped-def]
    """Heights at points by bilinear interpolation; beyond the grid its border goes on.

    `height`, float32, shape (ny, nx), begins at `x0`, `y0`; `x`, `y`, shape (n,), and `out` are
    float64. NaN gives NaN.
    """
    ny, nx = height.shape
    right, top = nx - 1, ny - 1
    for i in range(len(out)):
        px, py = (x[i] - x0) / step, (y[i] - y0) / step
        if np.isnan(px + py):
            out[i] = np.nan
            continue
        px, py = min(max(px, 0.0), np.float64(right)), min(max(py, 0.0), np.float64(top))
        column, row = np.int64(px), np.int64(py)
        beside, above = min(column + 1, right), min(row + 1, top)
        fx, fy = px - column, py - row
        low = height[row, column] * (1 - fx) + height[row, beside] * fx
        high = height[above, column] * (1 - fx) + height[above, beside] * fx
        out[i] = low * (1 - fy) + high * fy


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_slopes(height, twice, values):  # type: ignore[no-untyped-def]
    """Write heights and their slopes along x and y beside each other.

    `height`, float32, shape (ny, nx), is in mm, and so is `twice`, float32, two steps of the grid;
    `values` is float32, shape (ny, nx, 4), zero. Slopes stay zero on the border, each along its
    own axis; nothing is written to the last of the four.
    """
    ny, nx = height.shape
    for row in range(ny):
        for column in range(nx):
            values[row, column, 0] = height[row, column]
        for column in range(1, nx - 1):
            values[row, column, 1] = (height[row, column + 1] - height[row, column - 1]) / twice
        if 0 < row < ny - 1:
            for column in range(nx):
                change = height[row + 1, column] - height[row - 1, column]
                values[row, column, 2] = change / twice
