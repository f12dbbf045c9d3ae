"""Loops over planes and cells that look for peaks; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _shear(measure, moved, most):  # type: ignore[no-untyped-def]
    """Move the focus measure so many columns on, by plane, between columns; 0 beyond the grid.

    `most`, shape (rows, columns), zero, is set to the most of any plane: none is below zero.
    """
    planes, height, width = measure.shape
    # A row with a column of 0 before it and two after it.
    line = np.zeros(width + 3, np.float32)
    column, share = np.empty(width, np.int32), np.empty(width, np.float32)
    for k in range(planes):
        for j in range(width):
            at = j + moved[k, j]
            a = int(np.floor(at))
            share[j] = np.float32(at - a)
            column[j] = a + 1 if -1 <= a <= width else width + 1
        for i in range(height):
            some = False
            for j in range(width):
                value = measure[k, i, j]
                line[np.uint64(j) + np.uint64(1)] = value
                some |= value != 0
            if not some:
                continue
            for j in range(width):
                at_left = np.uint64(column[j])
                left = line[at_left]
                value = left + share[j] * (line[at_left + np.uint64(1)] - left)
                measure[k, i, j] = value
                most[i, j] = max(most[i, j], value)


@njit(cache=True, nogil=True)
def _rows_searched(first, last, spans):  # type: ignore[no-untyped-def]
    """First and last plane that any cell of a row is searched on; see `_find_peak`.

    A cell whose last is negative isn't searched. `spans`, shape (rows, 2), takes them.
    """
    height, width = first.shape
    for i in range(height):
        low, high = np.int32(2**30), np.int32(-(2**30))
        for j in range(width):
            low = min(low, first[i, j] if last[i, j] >= 0 else np.int32(2**30))
            high = max(high, last[i, j])
        spans[i, 0], spans[i, 1] = low, high


@njit(cache=True, nogil=True)
def _keep_best(scores, k, inner, first, last, total, top, best):  # type: ignore[no-untyped-def]
    """Take plane `k` of a row of cells into the sums, and where it is best; see `_find_peak`.

    Planes come in order. Maxima, as what is kept in one case and written in the other becomes a
    masked store, which takes many times as long on some processors.
    """
    plane = np.int32(k)
    counts = np.int32(inner) * plane
    for j in range(len(scores)):
        score = scores[j]
        inside = (plane >= first[j]) & (plane <= last[j])
        value = score if inside else np.float32(0)
        total[j] += value
        was = top[j]
        best[j] = max(best[j], counts * np.int32(inside & (value > was)))
        if inner:
            top[j] = max(value, was)


@njit(cache=True, nogil=True)
def _rivalled(scores, first, last, best, rival):  # type: ignore[no-untyped-def]
    """Whether beyond a valley beside the best plane another reaches a share of its score."""
    limit = rival * scores[best]
    for step in (-1, 1):
        k = best
        lowest = scores[best]
        while first <= k + step <= last:
            k += step
            lowest = min(lowest, scores[k])
            # A dent on the flank is no valley.
            if scores[k] >= limit and lowest < 0.8 * scores[k]:
                return True
    return False


@njit(cache=True, nogil=True)
def _find_peak(scores, first, last, rival, weakest, least, peak, contrast, top):  # type: ignore[no-untyped-def]
    """Highest score among planes first..last of each cell, between planes.

    NaN where it lies at an end of the search or of the range: the top was not seen. `contrast`
    tells how it stands out of the planes searched; `top` is its score. NaN also below the score
    `weakest` and the contrast `least`, and where another peak, beyond a valley, reaches the share
    `rival` of the score: which of the two is the surface is open.
    """
    n, height, width = scores.shape
    total = np.empty(width, np.float32)
    best = np.empty(width, np.int32)
    for i in range(height):
        top[i] = -1
        total[:] = 0
        best[:] = 0
        low, high = n, -1
        for j in range(width):
            low = min(low, first[i, j] if last[i, j] >= 0 else n)
            high = max(high, last[i, j])
        for k in range(max(low, 0), min(high, n - 1) + 1):
            _keep_best(scores[k, i], k, 1 <= k <= n - 2, first[i], last[i], total, top[i], best)
        for j in range(width):
            k = best[j]
            peak[i, j] = np.nan
            contrast[i, j] = 0
            if k < 1 or not top[i, j] > 0 or top[i, j] < weakest:
                continue
            left = scores[k - 1, i, j]
            right = scores[k + 1, i, j]
            if not (top[i, j] >= left and top[i, j] >= right):
                continue
            low = max(first[i, j], 0)
            high = min(last[i, j], n - 1)
            stands_out = 1 - total[j] / ((high - low + 1) * top[i, j])
            if stands_out >= least and _rivalled(scores[:, i, j], low, high, k, rival):
                continue
            contrast[i, j] = stands_out
            if stands_out >= least:
                bend = left - 2 * top[i, j] + right
                peak[i, j] = k + (0.5 * (left - right) / bend if bend < 0 else 0.0)


@njit(cache=True, nogil=True)
def _top_between(scores, at, peak, offset):  # type: ignore[no-untyped-def]
    """Top of the parabola through a peak's three planes, which need not be evenly spaced.

    `at`, shape (planes, columns), holds their offsets; `offset` is left where `peak` is NaN, and
    where rounding has put planes into one place: a column that few parts saw.
    """
    _, height, width = scores.shape
    for i in range(height):
        for j in range(width):
            if np.isnan(peak[i, j]):
                continue
            k = int(np.rint(peak[i, j]))
            middle = at[k, j]
            a = at[k - 1, j] - middle
            b = at[k + 1, j] - middle
            if a * b >= 0.0:
                continue
            left = np.float64(scores[k - 1, i, j]) - scores[k, i, j]
            right = np.float64(scores[k + 1, i, j]) - scores[k, i, j]
            # Twice the bend, and the slope in the middle.
            bend = (right / b - left / a) / (b - a)
            slope = left / a - bend * a
            offset[i, j] = middle + (-0.5 * slope / bend if bend < 0 else 0.0)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _centroids(measure, peak, weights, total, x, y):  # type: ignore[no-untyped-def]
    """Weighted focus measure on each cell's own plane, and where around the cell it lies, in cells.

    `peak` is between planes, NaN where there is none. `weights` are of one axis, shape
    (2·reach + 1,).
    """
    _, height, width = measure.shape
    reach = len(weights) // 2
    steps = np.arange(-reach, reach + 1).astype(np.float32)
    for i in range(height):
        for j in range(width):
            total[i, j] = 0
            x[i, j] = j
            y[i, j] = i
            if np.isnan(peak[i, j]):
                continue
            k = int(np.rint(peak[i, j]))
            e = np.float32(0)
            ex = np.float32(0)
            ey = np.float32(0)
            first, last = max(j - reach, 0), min(j + reach + 1, width)
            count = np.uint64(last - first)
            place, before = np.uint64(first), np.uint64(reach + first - j)
            for di in range(max(-reach, -i), min(reach + 1, height - i)):
                # Rows by themselves: sums of one after the other would wait for each other.
                row = measure[k, i + di]
                own = np.float32(0)
                along = np.float32(0)
                for n in range(count):
                    w = weights[before + n] * row[place + n]
                    own += w
                    along += w * steps[before + n]
                down = weights[di + reach]
                e += down * own
                ex += down * along
                ey += down * own * np.float32(di)
            total[i, j] = e
            if e > 0:
                x[i, j] = j + ex / e
                y[i, j] = i + ey / e


@njit(cache=True, nogil=True, error_model="numpy")
def _heights(offset, per_offset, unknown, heights):  # type: ignore[no-untyped-def]
    """Offsets as whole numbers up to ±32000, `unknown` where there is none; if there is one."""
    most, scale = np.float32(32000), np.float32(per_offset)
    some = False
    for i in range(offset.shape[0]):
        for j in range(offset.shape[1]):
            z = offset[i, j]
            known = z == z
            height = np.rint(min(max(z * scale, -most), most)) if known else np.float32(unknown)
            heights[i, j] = np.int16(height)
            some |= known
    return some
