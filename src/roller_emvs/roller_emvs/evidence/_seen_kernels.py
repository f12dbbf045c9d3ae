"""Loops over cells for the slopes that saw them; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _copy


@njit(cache=True, nogil=True)
def _inside(i, size):  # type: ignore[no-untyped-def]
    """A place within a grid; what lies just beyond is that as far within (reflected)."""
    if i < 0:
        return min(-i, size - 1)
    return i if i < size else max(2 * size - 2 - i, 0)


@njit(cache=True, nogil=True)
def _grow(offset, known, out):  # type: ignore[no-untyped-def]
    """Offsets of cells, and next to them the mean of their neighbours; NaN elsewhere.

    `known`, of the rows, is for use.
    """
    height, width = offset.shape
    for i in range(height):
        some = False
        for j in range(width):
            some |= offset[i, j] == offset[i, j]
        known[i] = some
    for i in range(height):
        _copy(offset[i], out[i])
        if not (known[_inside(i - 1, height)] or known[i] or known[_inside(i + 1, height)]):
            continue
        for j in range(width):
            if offset[i, j] == offset[i, j]:
                continue
            total, count = np.float32(0), 0
            for di in range(-1, 2):
                row = _inside(i + di, height)
                for dj in range(-1, 2):
                    z = offset[row, _inside(j + dj, width)]
                    if z == z:
                        total += z
                        count += 1
            if count:
                out[i, j] = total / np.float32(count)


@njit(cache=True, nogil=True, error_model="numpy")
def _statistics(sums, count, mean, spread):  # type: ignore[no-untyped-def]
    """Events of cells, the mean of their slopes, and the width of an even spread of their variance.

    From their count, and the sums of slopes and of squares, shape (rows, columns, 3).
    """
    twelve, zero = np.float32(12), np.float32(0)
    height, width, _ = sums.shape
    for i in range(height):
        for j in range(width):
            n = sums[i, j, 0]
            count[i, j] = n
            mean[i, j] = spread[i, j] = zero
            if n > zero:
                each = np.float32(1.0 / max(np.float64(n), 1e-9))
                own = sums[i, j, 1] * each
                variance = max(sums[i, j, 2] * each - own * own, zero)
                mean[i, j] = own
                spread[i, j] = np.sqrt(twelve * variance)


@njit(cache=True, nogil=True, error_model="numpy")
def _change(count, mean, middle, spread, scale, limits, per_column, waits, change):  # type: ignore[no-untyped-def]
    """How fast cells gain contrast; see `crossing_change`.

    `count` and `mean` are those of `_statistics`, `middle` and `spread` of the rays' slopes that a
    column can be seen with, `scale` what makes rays' slopes of the others. `limits`: events from
    which on the mean says something, and the change from which on it says less. `per_column` are
    columns of pixels a cell times the focal length, `waits` what a pixel waits by crossing, and
    the largest share of time that it is taken to be blind.
    """
    enough, steep = limits
    wait, blind = waits
    height, width = count.shape
    for i in range(height):
        for j in range(width):
            change[i, j] = 0
            if count[i, j] > enough:
                beside = np.float64(mean[i, j]) * scale - middle[j]
                gain = beside / (spread[j] ** 2 / 12)
                gain /= 1.0 + (gain / steep) ** 2
                crossed = np.float64(count[i, j]) / (per_column * spread[j])
                seeing = 1.0 - min(crossed * wait, blind)
                change[i, j] = np.sqrt(crossed / seeing) * gain / seeing
