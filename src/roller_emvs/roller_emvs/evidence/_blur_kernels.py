"""Loops that sum planes of a grid over neighbourhoods; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _copy, _least, _most


@njit(cache=True, nogil=True)
def _reflect(i, size):  # type: ignore[no-untyped-def]
    """A place within a grid; what lies beyond is that as far within, the outer one left out."""
    if size == 1:
        return 0
    while i < 0 or i >= size:
        i = -i if i < 0 else 2 * size - 2 - i
    return i


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_pairs(own, weight, pairs, weights, sums):  # type: ignore[no-untyped-def]
    """Five weighted pairs and `own`, weighted too: sums are stored but once."""
    a, b, c, d, e, f, g, h, i, k = pairs
    u, v, w, x, y = weights
    for j in range(len(sums)):
        near = weight * own[j] + u * (a[j] + b[j]) + v * (c[j] + d[j])
        sums[j] = near + w * (e[j] + f[j]) + x * (g[j] + h[j]) + y * (i[j] + k[j])


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_pair(before, after, weight, sums):  # type: ignore[no-untyped-def]
    """Add one more weighted pair."""
    for j in range(len(sums)):
        sums[j] += weight * (before[j] + after[j])


@njit(cache=True, nogil=True)
def _weigh(values, first, last, step, weights, sums):  # type: ignore[no-untyped-def]
    """Weighted sums of what lies around places from one to another, flat, `step` apart.

    Of many rows at once: what is left over of a loop is done one by one. `weights` are three at
    least. What is added to goes by itself: it would pass for what is read elsewhere in its place,
    and no vector instructions be used.
    """
    reach, out, zero = len(weights) // 2, sums[first:last], np.float32(0)
    # Beyond the last one a weight of 0, of what is there.
    p, q, r = step, min(2, reach) * step, min(3, reach) * step
    s, t = min(4, reach) * step, min(5, reach) * step
    v = weights[reach + 2] if reach >= 2 else zero
    w = weights[reach + 3] if reach >= 3 else zero
    x = weights[reach + 4] if reach >= 4 else zero
    y = weights[reach + 5] if reach >= 5 else zero
    _add_pairs(
        values[first:last], weights[reach], (
            values[first - p : last - p], values[first + p : last + p],
            values[first - q : last - q], values[first + q : last + q],
            values[first - r : last - r], values[first + r : last + r],
            values[first - s : last - s], values[first + s : last + s],
            values[first - t : last - t], values[first + t : last + t],
        ),
        (weights[reach + 1], v, w, x, y), out,
    )  # fmt: skip
    for d in range(6, reach + 1):
        far = d * step
        before, after = values[first - far : last - far], values[first + far : last + far]
        _add_pair(before, after, weights[reach + d], out)


@njit(cache=True, nogil=True)
def _widen(flat, begin, size, reach, sources, line, to):  # type: ignore[no-untyped-def]
    """A row into a line, and what it is reflected to into the ends; whether any of it isn't 0."""
    some = False
    for j in range(size):
        value = flat[begin + j]
        line[to + reach + j] = value
        some |= value != 0
    if some:
        for d in range(reach):
            line[to + d] = flat[begin + sources[d]]
            line[to + reach + size + d] = flat[begin + sources[reach + d]]
    return some


@njit(cache=True, nogil=True)
def _runs(marked, runs):  # type: ignore[no-untyped-def]
    """First of each run of marked places and the one after its last; how many there are."""
    n, before = 0, False
    for i in range(len(marked)):
        if marked[i] and not before:
            runs[n, 0] = i
            n += 1
        if marked[i]:
            runs[n - 1, 1] = i + 1
        before = marked[i]
    return n


@njit(cache=True, nogil=True)
def _blur(volume, weights, wanted, marked, runs, buffers, out):  # type: ignore[no-untyped-def]
    """Sum each plane over a neighbourhood, by symmetric weights along columns and rows.

    The border is reflected. `wanted`, shape (rows, 2), holds the first and last plane on which a
    row is wanted; of others `out` isn't written. For use: `marked`, of the rows, `runs`, shape
    (rows, 2), and `buffers`, flat, of as many rows and columns and the weights' reach on all sides.
    """
    planes, height, width = volume.shape
    down, across = weights
    reach, beside = len(down) // 2, len(across) // 2
    low, high = _least(wanted[:, 0]), _most(wanted[:, 1])
    stride = width + 2 * beside
    lines, along, both = buffers
    flat = volume.reshape(-1)
    sources = np.empty(2 * beside, np.uint64)
    for d in range(beside):
        sources[d] = _reflect(d - beside, width)
        sources[beside + d] = _reflect(width + d, width)
    for k in range(max(low, 0), min(high, planes - 1) + 1):
        # Rows that are wanted, or near one that is: what others hold isn't asked for.
        last = -reach - 1
        for i in range(height):
            last = i if wanted[i, 0] <= k <= wanted[i, 1] else last
            runs[i, 0] = last
        last = height + reach
        for i in range(height - 1, -1, -1):
            last = i if runs[i, 0] == i else last
            marked[i] = i - runs[i, 0] <= reach or last - i <= reach
            if marked[i]:
                begin, at = np.uint64((k * height + i) * width), np.uint64((reach + i) * stride)
                marked[i] = _widen(
                    flat, begin, np.uint64(width), np.uint64(beside), sources, lines, at
                )
        # Nothing lies on the rows between, as far as it is asked for.
        last = -2 * reach - 1
        for i in range(height):
            last = i if marked[i] else last
            runs[i, 0] = last
        last = height + 2 * reach
        for i in range(height - 1, -1, -1):
            last = i if marked[i] else last
            if not marked[i] and min(i - runs[i, 0], last - i) <= 2 * reach:
                begin = (reach + i) * stride
                along[begin : begin + stride] = 0
        for n in range(_runs(marked, runs)):
            begin, end = (reach + runs[n, 0]) * stride, (reach + runs[n, 1]) * stride
            _weigh(lines, begin + beside, end - beside, 1, across, along)
        for d in range(-reach, reach):
            beyond = d if d < 0 else height + d
            a, b = (reach + beyond) * stride, (reach + _reflect(beyond, height)) * stride
            _copy(along[b : b + stride], along[a : a + stride])
        # Rows that are wanted, and that what was found reaches.
        last = -reach - 1
        for i in range(height):
            last = i if marked[i] else last
            runs[i, 0] = last
        last = height + reach
        for i in range(height - 1, -1, -1):
            last = i if marked[i] else last
            marked[i] = wanted[i, 0] <= k <= wanted[i, 1]
            if marked[i] and i - runs[i, 0] > reach and last - i > reach:
                marked[i] = False
                out[k, i, :] = 0
        for n in range(_runs(marked, runs)):
            begin, end = (reach + runs[n, 0]) * stride, (reach + runs[n, 1]) * stride
            _weigh(along, begin + beside, end - beside, stride, down, both)
        for i in range(height):
            if marked[i]:
                at = (reach + i) * stride + beside
                own, row = both[at : at + width], out[k, i]
                for j in range(width):
                    row[j] = own[j]
