"""Loops that put several views' maxima together from the votes of one."""

from __future__ import annotations

import numpy as np
from numba import njit

from ._vote_kernels import _columns, _vote


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_bands_views(  # type: ignore[no-untyped-def]
    rays, limits, starts, first, step, inverse, halves, pad, hats, chunk, lines, best, votes,
    index,
):  # fmt: skip
    """Maxima of every `step`-th band from `first` on in views shifted by halves of a pixel.

    `hats` must be zero and is left so. `lines` and `best` are pairs of arrays, of floating point
    numbers and of their bits, in the same place; see `_sweep_band_views`.
    """
    planes = len(inverse)
    views, height, width = votes.shape
    sums, keys = best
    rows = keys.shape[1]
    ranks = _rank_bits(planes)
    for b in range(first, len(starts) - 1, step):
        if starts[b] == starts[b + 1]:
            continue
        keys[:] = 0
        top = b * rows
        part = (starts[b], starts[b + 1])
        _sweep_band_views(
            rays, part, limits, inverse, halves, top, height, pad, hats, chunk, lines, keys
        )
        for j in range(views):
            own = min(rows, height - top) * width
            of_keys, of_image = j * rows * width, (j * height + top) * width
            _take_ranks(keys, of_keys, np.uint64(own), planes, ranks, index, of_image)
            _copy(sums, of_keys, np.uint64(own), votes, of_image)


@njit(cache=True, nogil=True)
def _take_ranks(keys, start, count, planes, ranks, index, to):  # type: ignore[no-untyped-def]
    """Planes by the ranks in keys, which are taken out."""
    flat, out = keys.reshape(-1), index.reshape(-1)
    at, own = np.uint64(start), np.uint64(to)
    bits, behind = np.int32(ranks), np.int32(planes)
    for i in range(count):
        rank = flat[at + i] & bits
        out[own + i] = np.uint16((behind - rank) * np.int32(rank > 0))
        flat[at + i] -= rank


@njit(cache=True, nogil=True)
def _copy(values, start, count, out, to):  # type: ignore[no-untyped-def]
    flat, copied = values.reshape(-1), out.reshape(-1)
    at, own = np.uint64(start), np.uint64(to)
    for i in range(count):
        copied[own + i] = flat[at + i]


@njit(cache=True, nogil=True)
def _rank_bits(planes):  # type: ignore[no-untyped-def]
    """All bits that ranks 1 to `planes` have."""
    bits = 1
    while bits < planes:
        bits = 2 * bits + 1
    return bits


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band_views(  # type: ignore[no-untyped-def]
    rays, part, limits, inverse, halves, top, height, pad, votes, chunk, lines, best
):
    """Running maxima of a band's rows in views shifted by halves of a pixel.

    Votes are hats on a grid of half pixels, shape (2, rows, 2, columns): of two planes, its whole
    and its half positions, `pad` pixels wider than the image on either side. A hat of one pixel
    is the sum of the hat of half a pixel in its middle and half of those beside it, so the views'
    votes are exactly bilinear. `lines`, shape (2, 2, columns), are such sums of a row of two
    planes at whole and at half positions.

    The bits of floating point numbers that aren't negative are in order like the numbers. The
    last of them give way to the plane's rank, the nearest's being the highest, and one maximum of
    such keys keeps the votes and the plane at once.
    """
    planes = len(inverse)
    views, own, width = best.shape
    rows, wide = votes.shape[1], votes.shape[3]
    low, high = _columns(rays, part, inverse, wide)
    if low >= high:
        return
    span = np.uint64(high - low)
    keep = ~best.dtype.type(_rank_bits(planes))
    flat, most = votes.reshape(-1), best.reshape(-1)
    sums, keys = lines[0].reshape(-1), lines[1].reshape(-1)
    # Beyond the columns that are written there are no votes.
    keys[:] = 0
    for k in range(0, planes, 2):
        # The second of an odd number of planes is the first once more.
        last = min(k + 1, planes - 1)
        for n in range(last - k + 1):
            _vote(rays, part, limits, inverse[k + n], top, height, True, votes[n], chunk)
        second = 2 * (last - k)
        for r in range(own):
            for n in range(last - k + 1):
                row = (n * rows + r + 1) * 2 * wide
                rank = best.dtype.type(planes - k - n)
                for odd in range(2):
                    if _any_odd(halves, k + n, odd):
                        middle, line = row + odd * wide + low, (2 * n + odd) * wide + low
                        beside = row + (1 - odd) * wide + low - 1 + odd
                        _add_hats(flat, middle, beside, span, sums, line)
                        _put_rank(keys, line, span, keep, rank)
                _clear(flat, row + low, span)
                _clear(flat, row + wide + low, span)
            for j in range(views):
                a = (halves[j, k] >> 1) + pad
                b = (halves[j, last] >> 1) + pad
                # The view's columns that see some of the votes; beyond them there are none.
                begin = max(low - max(a, b), 0)
                end = min(high - min(a, b), width)
                if begin < end:
                    a += (halves[j, k] & 1) * wide + begin
                    b += (second + (halves[j, last] & 1)) * wide + begin
                    at = (j * own + r) * width + begin
                    _keep_largest(keys, a, b, np.uint64(end - begin), most, at)


@njit(cache=True, nogil=True)
def _any_odd(halves, k, odd):  # type: ignore[no-untyped-def]
    """Whether a view sees plane k at half (or whole, `odd` 0) positions."""
    seen = False
    for j in range(len(halves)):
        seen |= halves[j, k] & 1 == odd
    return seen


@njit(cache=True, nogil=True, error_model="numpy")
def _add_hats(votes, middle, beside, count, sums, line):  # type: ignore[no-untyped-def]
    """Votes in the middle of positions, and half of those to either side."""
    half = votes.dtype.type(0.5)
    a = np.uint64(middle)
    b = np.uint64(beside)
    c = np.uint64(beside + 1)
    to = np.uint64(line)
    for i in range(count):
        sums[to + i] = votes[a + i] + half * (votes[b + i] + votes[c + i])


@njit(cache=True, nogil=True)
def _put_rank(keys, line, count, keep, rank):  # type: ignore[no-untyped-def]
    at = np.uint64(line)
    for i in range(count):
        keys[at + i] = (keys[at + i] & keep) | rank


@njit(cache=True, nogil=True)
def _clear(votes, start, count):  # type: ignore[no-untyped-def]
    at = np.uint64(start)
    for i in range(count):
        votes[at + i] = 0


@njit(cache=True, nogil=True)
def _keep_largest(keys, a, b, count, best, at):  # type: ignore[no-untyped-def]
    first = np.uint64(a)
    second = np.uint64(b)
    own = np.uint64(at)
    for i in range(count):
        best[own + i] = max(best[own + i], keys[first + i], keys[second + i])
