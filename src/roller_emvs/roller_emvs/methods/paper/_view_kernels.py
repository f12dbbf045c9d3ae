"""Loops that put several views' maxima together from the votes of one."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _most

from ._packed_kernels import RANK_BITS, TILE_BITS, _make_keys, _vote_packed, _whole


def runs(rows: int, tiles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Buffers of `_sweep_band_views`: runs of tiles and their counts, by row."""
    voted, seen = np.empty((2, rows + 1, tiles, 2), np.int64)
    return voted, np.empty(rows + 1, np.int64), seen, np.empty(rows, np.int64)


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_bands_views(  # type: ignore[no-untyped-def]
    rays, limits, starts, first, step, inverse, halves, pad, reached, active, hats, chunk, keys,
    runs, best, votes, index,
):  # fmt: skip
    """Maxima of every `step`-th band from `first` on in views shifted by halves of a pixel.

    `hats` must be zero and is left so. `reached` is that of `_count_reached`, `active`, shape
    (bands, rows, tiles), tells which tiles are looked at; see `_sweep_band_views` for the rest.
    """
    planes = len(inverse)
    views, height, width = votes.shape
    rows = best.shape[1]
    for b in range(first, len(starts) - 1, step):
        top = b * rows
        count = np.uint64(min(rows, height - top) * width)
        if starts[b] == starts[b + 1]:
            for j in range(views):
                votes[j, top : top + rows] = 0
                index[j, top : top + rows] = 0
            continue
        best[:] = 0
        part, whole = (starts[b], starts[b + 1]), _whole(_most(reached[b].reshape(-1)))
        _sweep_band_views(
            rays, part, limits, inverse, halves, top, height, pad, whole, reached[b], active[b],
            hats, chunk, keys, runs, best,
        )  # fmt: skip
        per_vote = np.float32(1.0 / (2 * whole))
        for j in range(views):
            of_best, of_image = j * rows * width, (j * height + top) * width
            _take_keys(best, of_best, count, planes, per_vote, votes, index, of_image)


@njit(cache=True, nogil=True)
def _take_keys(best, start, count, planes, per_vote, votes, index, to):  # type: ignore[no-untyped-def]
    """Votes and planes by keys."""
    keys, seen, out = best.reshape(-1), votes.reshape(-1), index.reshape(-1)
    at, own = np.uint64(start), np.uint64(to)
    ranks, behind = np.int32((1 << RANK_BITS) - 1), np.int32(planes)
    for i in range(count):
        key = keys[at + i]
        total = np.int32(key >> np.int32(RANK_BITS))
        seen[own + i] = np.float32(total) * per_vote
        out[own + i] = np.uint16((behind - (key & ranks)) * np.int32(total > 0))


@njit(cache=True, nogil=True)
def _find_runs(marked, wide, runs, counts):  # type: ignore[no-untyped-def]
    """Columns, from one on to another, of tiles side by side that are marked, and how many, by row.

    Not the first column and the last: what is in them has no neighbours.
    """
    for r in range(len(marked)):
        n, before = 0, False
        for t in range(marked.shape[1]):
            here = marked[r, t] > 0
            if here and not before:
                runs[r, n, 0] = max(t << TILE_BITS, 1)
                n += 1
            if here:
                runs[r, n - 1, 1] = min((t + 1) << TILE_BITS, wide - 1)
            before = here
        counts[r] = n


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band_views(  # type: ignore[no-untyped-def]
    rays, part, limits, inverse, halves, top, height, pad, whole, reached, active, votes, chunk,
    keys, runs, best,
):  # fmt: skip
    """Running maxima of a band's rows in views shifted by halves of a pixel.

    Votes are packed hats on a grid of half pixels, shape (2, rows, 2, columns): of two planes, its
    whole and its half positions, `pad` pixels wider than the image on either side. `keys`, shape
    (2, 2, columns), are a row's of two planes at whole and at half positions: votes, and below them
    the plane's rank, the nearest's being the highest, so that one maximum keeps both. `runs`, for
    use, are those of rows with votes and those of rows that are looked at, each with their counts.
    """
    planes, (views, own, width) = len(inverse), best.shape
    rows, wide = votes.shape[1], votes.shape[3]
    line, flat, most = keys.reshape(-1), votes.reshape(-1), best.reshape(-1)
    voted, voted_counts, seen, seen_counts = runs
    _find_runs(reached, wide, voted, voted_counts)
    _find_runs(active, wide, seen, seen_counts)
    for k in range(0, planes, 2):
        # The second of an odd number of planes is the first once more.
        last = min(k + 1, planes - 1)
        for n in range(last - k + 1):
            _vote_packed(rays, part, limits, inverse[k + n], top, height, whole, votes[n], chunk)
        second = 2 * (last - k)
        for r in range(min(own, height - top)):
            for run in range(seen_counts[r]):
                low, high = seen[r, run, 0], seen[r, run, 1]
                span = np.uint64(high - low)
                for n in range(last - k + 1):
                    row, rank = (n * rows + r + 1) * 2 * wide, planes - k - n
                    for odd in range(2):
                        if _any_odd(halves, k + n, odd):
                            middle, at = row + odd * wide + low, (2 * n + odd) * wide + low
                            beside = row + (1 - odd) * wide + low - 1 + odd
                            # Beside a run there is nothing.
                            line[at - 1] = line[at + high - low] = 0
                            _make_keys(flat, middle, beside, 2 * wide, span, rank, line, at)
                for j in range(views):
                    a = (halves[j, k] >> 1) + pad
                    b = (halves[j, last] >> 1) + pad
                    to = (j * own + r) * width
                    at_a, at_b = (halves[j, k] & 1) * wide, (second + (halves[j, last] & 1)) * wide
                    if abs(a - b) <= 1:
                        _keep_larger(line, at_a, at_b, a, b, low, high, width, most, to)
                    else:
                        _keep_larger(line, at_a, at_a, a, a, low, high, width, most, to)
                        _keep_larger(line, at_b, at_b, b, b, low, high, width, most, to)
        for r in range(len(reached)):
            for run in range(voted_counts[r]):
                low, span = voted[r, run, 0], np.uint64(voted[r, run, 1] - voted[r, run, 0])
                for n in range(last - k + 1):
                    _clear(flat, (n * rows + r) * 2 * wide + low, span)
                    _clear(flat, (n * rows + r) * 2 * wide + wide + low, span)


@njit(cache=True, nogil=True)
def _any_odd(halves, k, odd):  # type: ignore[no-untyped-def]
    """Whether a view sees plane k at half (or whole, `odd` 0) positions."""
    seen = False
    for j in range(len(halves)):
        seen |= halves[j, k] & 1 == odd
    return seen


@njit(cache=True, nogil=True)
def _clear(votes, start, count):  # type: ignore[no-untyped-def]
    at = np.uint64(start)
    for i in range(count):
        votes[at + i] = 0


@njit(cache=True, nogil=True)
def _keep_larger(keys, at_a, at_b, a, b, low, high, width, best, to):  # type: ignore[no-untyped-def]
    """Take columns of two planes, moved by `a` and `b`, no more than one apart, into a row's best.

    Columns that see none of them stay as they are.
    """
    begin, end = max(low - max(a, b), 0), min(high - min(a, b), width)
    if begin >= end:
        return
    first, second = np.uint64(at_a + a + begin), np.uint64(at_b + b + begin)
    own = np.uint64(to + begin)
    for i in range(np.uint64(end - begin)):
        best[own + i] = max(best[own + i], keys[first + i], keys[second + i])
