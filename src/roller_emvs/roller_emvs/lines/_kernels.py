"""Loops over events that fit lines to them; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _median_of_few


@njit(cache=True, nogil=True)
def _starts(counts, wanted, starts, place):  # type: ignore[no-untyped-def]
    """Where the events of each pixel begin if those of `wanted` pixels are put in order; how many.

    `wanted`, shape (rows, columns), is of the image, all others are flat.

    `place` is the same, -1 where there are none, as in the last entry of `counts`: nowhere.
    """
    n, none = np.int32(0), np.int32(-1)
    height, width = wanted.shape
    flat, size = wanted.reshape(-1), np.uint64(width)
    for i in range(height):
        begin, some = np.uint64(i * width), False
        for j in range(size):
            some |= flat[begin + j] != 0
        if some:
            for j in range(size):
                count = counts[begin + j] if flat[begin + j] else np.int32(0)
                starts[begin + j] = n
                place[begin + j] = n if count else none
                n += count
        else:
            for j in range(size):
                starts[begin + j] = n
                place[begin + j] = none
    starts[-1] = n
    place[-1] = -1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _by_pixel(rays, pixel, place, out):  # type: ignore[no-untyped-def]
    """Rays in the order of their pixels.

    `place` is where each pixel's begin, and is moved on; below 0, they are left out.
    """
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    own, flat = rays.reshape(-1), out.reshape(-1)
    for i in range(np.uint64(len(pixel))):
        k = np.uint64(pixel[i])
        n = place[k]
        if n >= 0:
            # All are read before any is written, so that a ray is moved in one go.
            at, to = four * i, four * np.uint64(n)
            x, y, along, across = own[at], own[at + one], own[at + two], own[at + three]
            flat[to] = x
            flat[to + one] = y
            flat[to + two] = along
            flat[to + three] = across
            place[k] = n + 1


@njit(cache=True, nogil=True)
def _ridges(density, floor, share, reach, step, row, column):  # type: ignore[no-untyped-def]
    """Pixels of every `step`-th row that hold the most of their neighbours along the row.

    They must hold `floor`, and `share` of the most within `reach` columns. Returns their number;
    `row` and `column` hold as many as there is room for.
    """
    height, width = density.shape
    n = 0
    for y in range(0, height, step):
        for x in range(1, width - 1):
            d = density[y, x]
            if d < floor or d < density[y, x - 1] or d <= density[y, x + 1]:
                continue
            most = d
            for k in range(max(x - reach, 0), min(x + reach + 1, width)):
                most = max(most, density[y, k])
            if d >= share * most and n < len(row):
                row[n] = y
                column[n] = x
                n += 1
    return n


@njit(cache=True, nogil=True)
def _vote(row, x, slope, offset, last, reach_y, reach_x, most, votes, near):  # type: ignore[no-untyped-def]
    """Median offset of the lines along each line's contour, and how many there are.

    Lines are sorted by row; `last[k]` is where the rows from `row[k]` + `reach_y` on begin.
    """
    values = np.empty(most)
    first = 0
    for k in range(len(row)):
        while row[first] < row[k] - reach_y:
            first += 1
        n = 0
        for j in range(first, last[k]):
            if abs(x[j] - x[k] - slope[k] * (row[j] - row[k])) < reach_x and n < most:
                values[n] = offset[j]
                n += 1
        votes[k] = _median_of_few(values[:n])
        near[k] = n


@njit(cache=True, nogil=True)
def _along(row, x, slope, value, variance, last, reach_y, reach_x, spread, mean, left):  # type: ignore[no-untyped-def]
    """Mean of a value of the lines along each line's contour, and its variance if none is shared.

    By their variance and a Gaussian over rows of deviation `spread`. Lines are sorted by row;
    `last[k]` is where the rows from `row[k]` + `reach_y` on begin.
    """
    first = 0
    for k in range(len(row)):
        while row[first] < row[k] - reach_y:
            first += 1
        total = summed = squares = 0.0
        for j in range(first, last[k]):
            rows = row[j] - row[k]
            if abs(x[j] - x[k] - 0.5 * (slope[k] + slope[j]) * rows) < reach_x:
                w = np.exp(-0.5 * (rows / spread) ** 2) / variance[j]
                total += w
                summed += w * value[j]
                squares += w * w * variance[j]
        mean[k] = summed / total
        left[k] = squares / total**2
