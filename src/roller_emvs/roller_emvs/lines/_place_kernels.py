"""Loops over lines and points that put both together; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_emvs.evidence import CELL_PX

#: Rows and columns, px, to a cell of the grid on which lines are added up: what is around a place
#: changes little from pixel to pixel.
GRID_PX = 2
#: Variance that this and what lies between cells add to a neighbourhood, along rows and across,
#: cells².
WIDER = 0.25, 0.125


@njit(cache=True, nogil=True, error_model="numpy")
def _judge(  # type: ignore[no-untyped-def]
    row, x, offset, variance, surface, changes, sides, scales, limits, slope, change, side, sigma
):
    """Slope of the surface at lines, change and side of the cells there, and their uncertainty.

    `surface` is the offset by pixel, `variance` that of the lines' offsets. `scales`: from a change
    of offset by pixel to the slope, and from an offset to metres. `limits`: share of what line and
    surface differ by that stays in doubt, the least slope, what the place is unsure of, m, and the
    least uncertainty, m.
    """
    width = surface.shape[1]
    per_px, to_m = scales
    doubt, least, place, floor = limits
    step = np.float32(1.0 / CELL_PX)
    for n in range(len(row)):
        i, j = row[n], min(max(np.int64(np.rint(x[n])), 0), width - 1)
        left, here = surface[i, max(j - CELL_PX, 0)], surface[i, j]
        right = surface[i, min(j + CELL_PX, width - 1)]
        if left != left:
            along = (right - here) * step
        elif right != right:
            along = (here - left) * step
        else:
            along = (right - left) * np.float32(0.5) * step
        slope[n] = -np.float64(along) * per_px if along == along else 0.0
        lacks = np.float64(here) - offset[n] if here == here else 0.0
        of_place = max(abs(slope[n]), least) * place
        square = variance[n] * to_m**2 + (lacks * to_m * doubt) ** 2 + of_place**2
        sigma[n] = np.sqrt(square + floor**2)
        change[n] = changes[i // CELL_PX, j // CELL_PX]
        side[n] = sides[i // CELL_PX, j // CELL_PX]


@njit(cache=True, nogil=True)
def _add_lines(row, column, values, sums):  # type: ignore[no-untyped-def]
    """Values of lines, shape (values, n), by cell of their pixels.

    `sums`, shape (rows, columns, values), is added to.
    """
    for k in range(len(row)):
        for v in range(len(values)):
            sums[row[k] // GRID_PX, column[k] // GRID_PX, v] += values[v, k]


@njit(cache=True, nogil=True)
def _place(sums, row, column):  # type: ignore[no-untyped-def]
    """Cells around a pixel, rows and columns, and the shares of the second of each."""
    height, width, _ = sums.shape
    # Lines lie on the first of a cell's rows, and on any of its columns.
    y = min(row / GRID_PX, height - 1.0)
    x = min(max((column - 0.5 * (GRID_PX - 1)) / GRID_PX, 0.0), width - 1.0)
    i, j = int(y), int(x)
    return i, min(i + 1, height - 1), j, min(j + 1, width - 1), y - i, x - j


@njit(cache=True, nogil=True)
def _between(sums, at, value):  # type: ignore[no-untyped-def]
    """A value between cells; see `_place`."""
    i, below, j, right, down, along = at
    up = sums[i, j, value] + along * (sums[i, right, value] - sums[i, j, value])
    low = sums[below, j, value] + along * (sums[below, right, value] - sums[below, j, value])
    return up + down * (low - up)


@njit(cache=True, nogil=True, error_model="numpy")
def _move(row, column, offset, sigma, blurred, limits, moved, unsure):  # type: ignore[no-untyped-def]
    """Points moved by what the lines around say, as far as those are surer; and how sure they are.

    `blurred`, over a neighbourhood, are the sums of the lines' weights w, of w·m, w·m², w·x, w·x²
    and w·m·x, m what they move points by and x their columns from a middle on. m is taken to go
    linearly with x, and yet all that they differ by makes points unsure. `limits`: that middle,
    what holds its slope back, px², the share of a line in the neighbourhood's middle, and the least
    variance.
    """
    middle, stiff, peak, floor = limits
    for n in range(len(row)):
        at = _place(blurred, row[n], column[n])
        total = _between(blurred, at, 0)
        some = max(total, 1e-30)
        mean = _between(blurred, at, 1) / some
        apart = max(_between(blurred, at, 2) / some - mean * mean, 0.0)
        x = _between(blurred, at, 3) / some
        spread = max(_between(blurred, at, 4) / some - x * x, 0.0)
        shared = _between(blurred, at, 5) / some - mean * x
        slope = shared / (spread + stiff)
        by = mean + slope * (column[n] - middle - x)
        own = 1.0 / max(total * peak, 1e-30) + floor
        before = np.float64(sigma[n]) ** 2
        gain = before / (before + own)
        left = min(before, max((1.0 - gain) * before, own))
        moved[n] = offset[n] + gain * by
        unsure[n] = np.sqrt(left + np.sqrt(gain) * apart + ((1.0 - gain) * by) ** 2)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_variance(row, column, blurred, sigma):  # type: ignore[no-untyped-def]
    """Points less sure by the mean variance around them: `blurred` are how many, and their sum."""
    for n in range(len(row)):
        at = _place(blurred, row[n], column[n])
        square = _between(blurred, at, 1) / max(_between(blurred, at, 0), 1e-9)
        sigma[n] = np.sqrt(np.float64(sigma[n]) ** 2 + square)


@njit(cache=True, nogil=True)
def _surer(  # type: ignore[no-untyped-def]
    row, column, tilt, sigma, steps, reach, number, point_sigma, sure, least, line, to_row,
    to_column, beside, most,
):  # fmt: skip
    """Places of lines that are surer than the points beside them.

    A line lies on `steps` rows; points within `reach` columns are beside it, and one must be there;
    of two lines beside each other the surer one counts. `number` is the point at each pixel, -1 for
    none, `sure` the points' confidence; `least`, of pixels, must be infinite. Returns how many
    places there are; of each: the line, its row and column, the point of the least sigma, and the
    most confidence.
    """
    height, width = number.shape
    for step in range(steps):
        for k in range(len(row)):
            i = row[k] + step
            near = np.int64(np.rint(column[k] + tilt[k] * step))
            if i < height and reach <= near < width - reach:
                for j in range(near - reach, near + reach + 1):
                    least[i, j] = min(least[i, j], sigma[k])
    n = 0
    for step in range(steps):
        for k in range(len(row)):
            i = row[k] + step
            at = column[k] + tilt[k] * step
            near = np.int64(np.rint(at))
            if not (i < height and reach <= near < width - reach):
                continue
            surest = -1
            lowest = np.inf
            most[n] = 0
            for j in range(near - reach, near + reach + 1):
                lowest = min(lowest, least[i, j])
                point = number[i, j]
                if point >= 0:
                    most[n] = max(most[n], sure[point])
                    if surest < 0 or point_sigma[point] < point_sigma[surest]:
                        surest = point
            if surest >= 0 and sigma[k] < point_sigma[surest] and lowest >= sigma[k]:
                line[n] = k
                to_row[n] = i
                to_column[n] = at
                beside[n] = surest
                n += 1
    return n
