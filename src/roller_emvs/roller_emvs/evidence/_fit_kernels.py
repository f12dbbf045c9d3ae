"""Loops over cells that fit planes to depths; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

#: Spread of samples, in cells², below which a slope is not taken from them alone.
_STIFFNESS = 0.05
#: The moments that hang on offsets.
OF_OFFSET = slice(6, 9)


@njit(cache=True, nogil=True)
def _mark(offset, x, y, cells):  # type: ignore[no-untyped-def]
    """Mark cells that have a depth, and those that its evidence lies in."""
    height, width = offset.shape
    for i in range(height):
        for j in range(width):
            if offset[i, j] == offset[i, j]:
                cells[i, j] = True
                row = min(max(int(np.rint(y[i, j])), 0), height - 1)
                cells[row, min(max(int(np.rint(x[i, j])), 0), width - 1)] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(offset, x, y, measure, row, column, weight):  # type: ignore[no-untyped-def]
    """Weight of each depth, and the cell that its evidence lies in; weight 0 where there is none.

    The power of the focus measure lies between that of a steady count's variance, 1, and its
    root: bright edges shouldn't silence faint ones.
    """
    height, width = offset.shape
    for i in range(height):
        for j in range(width):
            weight[i, j] = 0.0
            row[i, j] = i
            column[i, j] = j
            if np.isnan(offset[i, j]) or not measure[i, j] > 0:
                continue
            e = np.float64(measure[i, j])
            weight[i, j] = np.sqrt(e * np.sqrt(e))
            row[i, j] = min(max(int(np.rint(y[i, j])), 0), height - 1)
            column[i, j] = min(max(int(np.rint(x[i, j])), 0), width - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_moments(offset, x, y, weight, row, column, moments):  # type: ignore[no-untyped-def]
    """Weighted sums of 1, x, y, x², xy, y², z, xz and yz by cell; `offset` is z."""
    real = moments.dtype.type
    height, width = offset.shape
    for i in range(height):
        for j in range(width):
            w = weight[i, j]
            if w == 0:
                continue
            a = real(x[i, j])
            b = real(y[i, j])
            z = real(offset[i, j])
            r = row[i, j]
            c = column[i, j]
            moments[0, r, c] += w
            moments[1, r, c] += w * a
            moments[2, r, c] += w * b
            moments[6, r, c] += w * z
            moments[3, r, c] += w * a * a
            moments[4, r, c] += w * a * b
            moments[5, r, c] += w * b * b
            moments[7, r, c] += w * a * z
            moments[8, r, c] += w * b * z


@njit(cache=True, nogil=True, error_model="numpy")
def _add_offsets(offset, x, y, weight, row, column, moments):  # type: ignore[no-untyped-def]
    """Those of `_add_moments` that hang on offsets."""
    real = moments.dtype.type
    height, width = offset.shape
    for i in range(height):
        for j in range(width):
            w = weight[i, j]
            if w == 0:
                continue
            z = real(offset[i, j])
            r = row[i, j]
            c = column[i, j]
            moments[6, r, c] += w * z
            moments[7, r, c] += w * real(x[i, j]) * z
            moments[8, r, c] += w * real(y[i, j]) * z


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(moments, planes):  # type: ignore[no-untyped-def]
    """Planes through the depths around each cell: mean x, y, z and slopes along x and y.

    `moments` are summed over neighbourhoods. NaN where there is no weight.
    """
    real = moments.dtype.type
    stiffness = real(_STIFFNESS)
    _, height, width = moments.shape
    for i in range(height):
        for j in range(width):
            w = moments[0, i, j]
            each = real(1) / w if w > real(1e-9) else real(np.nan)
            x = moments[1, i, j] * each
            y = moments[2, i, j] * each
            z = moments[6, i, j] * each
            xx = moments[3, i, j] * each - x * x + stiffness
            xy = moments[4, i, j] * each - x * y
            yy = moments[5, i, j] * each - y * y + stiffness
            xz = moments[7, i, j] * each - x * z
            yz = moments[8, i, j] * each - y * z
            of_det = real(1) / (xx * yy - xy * xy)
            planes[0, i, j] = x
            planes[1, i, j] = y
            planes[2, i, j] = z
            planes[3, i, j] = (yy * xz - xy * yz) * of_det
            planes[4, i, j] = (xx * yz - xy * xz) * of_det


@njit(cache=True, nogil=True, error_model="numpy")
def _add_residuals(offset, x, y, weight, row, column, trust, planes, sums):  # type: ignore[no-untyped-def]
    """Sums of w·r, w, w·r² and w² by cell; r is a depth less the plane where it lies."""
    real = sums.dtype.type
    height, width = offset.shape
    for i in range(height):
        for j in range(width):
            r = row[i, j]
            c = column[i, j]
            w = weight[i, j] * trust[r, c]
            if w == 0:
                continue
            rest = (
                real(offset[i, j])
                - planes[2, r, c]
                - planes[3, r, c] * (real(x[i, j]) - planes[0, r, c])
                - planes[4, r, c] * (real(y[i, j]) - planes[1, r, c])
            )
            sums[1, r, c] += w
            sums[3, r, c] += w * w
            sums[0, r, c] += w * rest
            sums[2, r, c] += w * rest * rest


@njit(cache=True, nogil=True, error_model="numpy")
def _trust(weight, square, least, trust):  # type: ignore[no-untyped-def]
    """Inverse of the variance of depths about their planes, by that `least` one there can be."""
    real = trust.dtype.type
    smallest, unit = real(1e-12), real(least)
    height, width = trust.shape
    for i in range(height):
        for j in range(width):
            trust[i, j] = unit / (square[i, j] / max(weight[i, j], smallest) + unit)


@njit(cache=True, nogil=True, error_model="numpy")
def _at_cells(planes, middle, weight, rest, share, offset):  # type: ignore[no-untyped-def]
    """Height of planes at their own cells, and a share of what they leave over.

    `weight` and `rest` are of the sums of `_add_residuals` over neighbourhoods;
    `middle` is the column and the row that places count from.
    """
    real = offset.dtype.type
    height, width = offset.shape
    given = real(share)
    for i in range(height):
        down = real(i) - middle[1]
        for j in range(width):
            along = real(j) - middle[0]
            z = planes[2, i, j] + planes[3, i, j] * (along - planes[0, i, j])
            z += planes[4, i, j] * (down - planes[1, i, j])
            offset[i, j] = z + given * rest[i, j] / weight[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter(weight, squares, square_weight, scatter):  # type: ignore[no-untyped-def]
    """Deviation of depths times the unevenness of weights, their root mean square over their mean.

    From the sums of `_add_residuals` over what is taken to scatter alike.
    """
    height, width = scatter.shape
    for i in range(height):
        for j in range(width):
            w = weight[i, j]
            scatter[i, j] = np.sqrt(squares[i, j] / w * square_weight[i, j]) / w
