"""Loops over pixels that tell which of them are measured; each has a numpy twin in the tests.

They look at `spans` alone, shape (rows of cells, 2): the first column of cells that has a surface
and the one after the last. Elsewhere no event meets any.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._kernels import CELL_PX

#: Columns to either side in which an edge's fringe lies.
NEAR_PX = 5


@njit(cache=True, nogil=True)
def _spans(offset, other, spans):  # type: ignore[no-untyped-def]
    """Spans of the cells in which one of two surfaces isn't NaN."""
    height, width = offset.shape
    for i in range(height):
        first, last = width, 0
        for j in range(width):
            if offset[i, j] == offset[i, j] or other[i, j] == other[i, j]:
                first = min(first, j)
                last = j + 1
        spans[i, 0], spans[i, 1] = min(first, last), last


@njit(cache=True, nogil=True)
def _cell_means(values, spans, means):  # type: ignore[no-untyped-def]
    """Mean of the pixels of each cell; 0 beyond the spans."""
    share = np.float32(1.0 / CELL_PX**2)
    for i in range(len(means)):
        row = means[i]
        row[:] = 0
        first, last = np.uint64(spans[i, 0]), np.uint64(spans[i, 1])
        for y in range(i * CELL_PX, (i + 1) * CELL_PX):
            own = values[y]
            for j in range(first, last):
                at = np.uint64(CELL_PX) * j
                for d in range(np.uint64(CELL_PX)):
                    row[j] += own[at + d]
        for j in range(first, last):
            row[j] *= share


@njit(cache=True, nogil=True)
def _widen(cells, first, last, line):  # type: ignore[no-untyped-def]
    """A row of values of cells, from one to another, by pixel: linear between their middles."""
    width = len(cells)
    half, share = np.float32(0.5), np.float32(1.0 / CELL_PX)
    for j in range(first, last):
        here = cells[j]
        left, right = cells[max(j - 1, 0)], cells[min(j + 1, width - 1)]
        for d in range(CELL_PX):
            a = (np.float32(d) + half) * share - half
            beside = left if a < 0 else right
            line[j * CELL_PX + d] = here + abs(a) * (beside - here)


@njit(cache=True, nogil=True)
def _choose(support, around, other, other_around, least, spans, lines, which):  # type: ignore[no-untyped-def]
    """Which of two images of events gathers more at each pixel: 1, 2, or 0 for none of them.

    Events gather where there are at least `least`, and more than around, which is of cells and
    bilinear between them. Returns the number of pixels that have them. `lines`, four of the
    columns, are for use: two rows of cells of either image.
    """
    height, reach = len(around), CELL_PX // 2
    up, low, other_up, other_low = lines
    count = np.int64(0)
    for y in range(which.shape[0]):
        row = which[y]
        row[:] = 0
        first, last = spans[y // CELL_PX, 0], spans[y // CELL_PX, 1]
        if first >= last:
            continue
        i = (y + reach) // CELL_PX - 1
        if y % CELL_PX == 0 or y % CELL_PX == reach:
            above, below = max(i, 0), min(i + 1, height - 1)
            _widen(around[above], first, last, up)
            _widen(around[below], first, last, low)
            _widen(other_around[above], first, last, other_up)
            _widen(other_around[below], first, last, other_low)
        down = np.float32((y + 0.5) / CELL_PX - 0.5 - i)
        one, two = support[y], other[y]
        for x in range(np.uint64(first * CELL_PX), np.uint64(last * CELL_PX)):
            usual = up[x] + down * (low[x] - up[x])
            other_usual = other_up[x] + down * (other_low[x] - other_up[x])
            off = (one[x] >= least) & (one[x] > usual)
            on = (two[x] >= least) & (two[x] > other_usual) & ((two[x] > one[x]) | ~off)
            row[x] = max(np.uint8(off), np.uint8(2) * np.uint8(on))
        for x in range(np.uint64(first * CELL_PX), np.uint64(last * CELL_PX)):
            count += np.int64(row[x] > 0)
    return count


@njit(cache=True, nogil=True)
def _sum_rows(support, other, rows, first, last, line):  # type: ignore[no-untyped-def]
    """Sums of the larger of two images over five rows, from one column to another."""
    p, q, r, s, t = rows
    a, b, c, d, e = support[p], support[q], support[r], support[s], support[t]
    f, g, h, i, k = other[p], other[q], other[r], other[s], other[t]
    for x in range(np.uint64(first), np.uint64(last)):
        # Not max, which asks for NaN: so this becomes vector instructions.
        total = a[x] if a[x] > f[x] else f[x]
        total += b[x] if b[x] > g[x] else g[x]
        total += c[x] if c[x] > h[x] else h[x]
        total += d[x] if d[x] > i[x] else i[x]
        line[x] = total + (e[x] if e[x] > k[x] else k[x])


@njit(cache=True, nogil=True)
def _drop_fringe(support, other, share, spans, lines, which):  # type: ignore[no-untyped-def]
    """Make pixels 0 that have less than a share of the most events within `NEAR_PX` columns.

    Events are the mean of the larger of two images over three columns and five rows, reflected at
    the border. `lines`, two of the columns and twice `NEAR_PX`, are for use.
    """
    (height, width), one, two = which.shape, np.uint64(1), np.uint64(2)
    mean, least, near = 1.0 / 15.0, np.float32(share), np.uint64(NEAR_PX)
    sums, most = lines
    # Beyond the image there is nothing.
    most[:NEAR_PX] = most[NEAR_PX + width :] = 0
    for y in range(height):
        row = which[y]
        first, last = spans[y // CELL_PX, 0] * CELL_PX, spans[y // CELL_PX, 1] * CELL_PX
        if first >= last:
            continue
        down, further = y + 1, y + 2
        down = down if down < height else 2 * height - 2 - down
        further = further if further < height else 2 * height - 2 - further
        rows = abs(y - 2), abs(y - 1), y, down, further
        begin, end = max(first - NEAR_PX, 0), min(last + NEAR_PX, width)
        # Sums begin one place on, so that there is room for what is reflected.
        _sum_rows(support, other, rows, max(begin - 1, 0), min(end + 1, width), sums[1:])
        sums[0], sums[width + 1] = sums[2], sums[width - 1]
        for x in range(np.uint64(begin), np.uint64(end)):
            total = np.float64(sums[x] + sums[x + one] + sums[x + two])
            most[x + near] = np.float32(total * mean)
        for x in range(np.uint64(first), np.uint64(last)):
            # Of a fixed number, so that this becomes vector instructions too.
            highest = most[x]
            for k in range(np.uint64(2 * NEAR_PX + 1)):
                beside = most[x + k]
                highest = highest if highest > beside else beside
            row[x] *= np.uint8(most[x + near] >= least * highest)


@njit(cache=True, nogil=True)
def _between(cells, y, x):  # type: ignore[no-untyped-def]
    """Value between cells at a pixel, bilinear; beyond the outer cells' middles it stays."""
    half = np.float32(0.5)
    zero = np.float32(0)
    share = np.float32(1.0 / CELL_PX)
    height, width = cells.shape
    b = (np.float32(y) + half) * share - half
    a = (np.float32(x) + half) * share - half
    b = min(max(b, zero), np.float32(height - 1))
    a = min(max(a, zero), np.float32(width - 1))
    i = int(b)
    j = int(a)
    # At an outer cell's middle the next one doesn't count, not even if it is NaN.
    below = i + 1 if b > i else i
    right = j + 1 if a > j else j
    down = np.float32(b - i)
    across = np.float32(a - j)
    up = cells[i, j] + across * (cells[i, right] - cells[i, j])
    low = cells[below, j] + across * (cells[below, right] - cells[below, j])
    return up + down * (low - up)


@njit(cache=True, nogil=True)
def _take(which, spans, surfaces, confidences, scatter, limits, row, column, offset, sure, spread):  # type: ignore[no-untyped-def]
    """Pixels that were chosen, with their image's surface and confidence, and the scatter there.

    `surfaces` are by pixel, `confidences` and `scatter` by cell. `limits`: the scatter where it
    isn't known, that from which on, and the confidence, less for the scatter, below which a pixel
    is left out. Returns how many there are.
    """
    usual, most, least = np.float32(limits[0]), np.float32(limits[1]), np.float32(limits[2])
    n = 0
    for y in range(which.shape[0]):
        first, last = spans[y // CELL_PX, 0] * CELL_PX, spans[y // CELL_PX, 1] * CELL_PX
        for x in range(first, last):
            if which[y, x]:
                k = which[y, x] - 1
                wide = _between(scatter, y, x)
                wide = wide if np.isfinite(wide) else usual
                confidence = _between(confidences[k], y, x) / (np.float32(1) + wide * wide)
                if wide < most and confidence >= least:
                    row[n] = y
                    column[n] = x
                    offset[n] = surfaces[k][y, x]
                    sure[n] = confidence
                    spread[n] = wide
                    n += 1
    return n
