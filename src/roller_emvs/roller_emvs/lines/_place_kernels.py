"""Loops over lines and points that put both together; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _add_lines(row, column, weight, move, sums):  # type: ignore[no-untyped-def]
    """Weights of lines at their pixels, and those times what they move points by, and its square.

    `sums`, shape (3, rows, columns), is added to.
    """
    for k in range(len(row)):
        i = row[k]
        j = column[k]
        sums[0, i, j] += weight[k]
        sums[1, i, j] += weight[k] * move[k]
        sums[2, i, j] += weight[k] * move[k] * move[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _move(row, column, offset, sigma, blurred, peak, floor, moved, unsure):  # type: ignore[no-untyped-def]
    """Points moved by what the lines around say, as far as those are surer; and how sure they are.

    `blurred` are the sums of `_add_lines` over a neighbourhood, `peak` the share of a line in its
    middle, `floor` the least variance.
    """
    for n in range(len(row)):
        i = row[n]
        j = column[n]
        total = np.float64(blurred[0, i, j])
        some = max(total, 1e-30)
        by = blurred[1, i, j] / some
        apart = max(blurred[2, i, j] / some - by * by, 0.0)
        own = 1.0 / max(total * peak, 1e-30) + floor
        before = np.float64(sigma[n]) ** 2
        gain = before / (before + own)
        left = min(before, max((1.0 - gain) * before, own))
        moved[n] = offset[n] + gain * by
        unsure[n] = np.sqrt(left + np.sqrt(gain) * apart + ((1.0 - gain) * by) ** 2)


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
