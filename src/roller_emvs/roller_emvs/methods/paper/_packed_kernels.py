"""Loops over votes of whole numbers, two rows in one; each has a numpy twin in the tests.

A bilinear vote is of two rows and two columns. Shares are rounded to parts of a vote, so that one
addition serves both rows: the upper one's sum is in the lower 16 bits, that of the row below in the
upper ones. So a vote is two additions instead of four.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Columns that are looked at or left out together: 2^n.
TILE_BITS = 5
#: Bits of a plane's rank, from 1 on, below votes.
RANK_BITS = 15
#: Sums of two rows are below this, so that neither reaches the other's bits; what a vote counts at
#: most, so that floating point numbers hold both rows' shares.
_MOST_SUM, _MOST_WHOLE = 1 << 15, 255
#: Rays that are placed before they vote.
_CHUNK = 256
#: What rounding may move a place by, rows, and columns that votes reach to either side.
_ROUNDING, _LEFT, _RIGHT = 0.01, 2.0, 3.0


def chunk() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Buffers of `_vote_packed`: two places and two shares for each ray at hand."""
    places, besides, left, right = np.empty((4, _CHUNK), np.int32)
    return places, besides, left, right


@njit(cache=True, nogil=True, error_model="numpy")
def _count_reached(rays, starts, first, step, ends, chunk, reached):  # type: ignore[no-untyped-def]
    """Rays that reach each tile of columns between two planes, by row, of every `step`-th band.

    `reached`, shape (bands, rows + 1, tiles), must be zero: rows are those that rays lie below,
    from the one above the band on. `chunk` is for use.
    """
    rows, tiles = reached.shape[1:]
    for b in range(first, len(starts) - 1, step):
        own = reached[b].reshape(-1)
        for start in range(starts[b], starts[b + 1], _CHUNK):
            begin, count = np.uint64(start), np.uint64(min(_CHUNK, starts[b + 1] - start))
            limits = np.float32(b * (rows - 1) - 1), np.float32(rows - 1), np.float32(tiles - 1)
            _reach(rays, begin, count, ends, limits, chunk)
            for i in range(count):
                for r in range(chunk[0][i], chunk[1][i] + 1):
                    for t in range(r * tiles + chunk[2][i], r * tiles + chunk[3][i] + 1):
                        own[np.uint64(t)] += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _reach(rays, begin, count, ends, limits, chunk):  # type: ignore[no-untyped-def]
    """First and last row, first and last tile that rays reach."""
    low, high = ends
    origin, below, last = limits
    top, bottom, left, right = chunk
    zero, margin = np.float32(0), np.float32(_ROUNDING)
    per_px = np.float32(1.0 / (1 << TILE_BITS))
    x, y, dx, dy = rays[0], rays[1], rays[2], rays[3]
    for i in range(count):
        at = begin + i
        x0, x1 = x[at] + dx[at] * low, x[at] + dx[at] * high
        y0, y1 = y[at] + dy[at] * low - origin, y[at] + dy[at] * high - origin
        # Not min and max, which ask for NaN: so this becomes vector instructions.
        near, far = (x0, x1) if x0 < x1 else (x1, x0)
        upper, lower = (y0, y1) if y0 < y1 else (y1, y0)
        upper, lower = upper - margin, lower + margin
        near, far = (near - np.float32(_LEFT)) * per_px, (far + np.float32(_RIGHT)) * per_px
        top[i] = np.int32(upper if upper > zero else zero)
        bottom[i] = np.int32(lower if lower < below else below)
        left[i] = np.int32(near if near > zero else zero)
        right[i] = np.int32(far if far < last else last)


@njit(cache=True, nogil=True)
def _whole(most):  # type: ignore[no-untyped-def]
    """What a vote counts, for so many rays in a tile; 0 for too many."""
    # Of each of a vote's four shares rounding makes one more at most.
    return max(min((_MOST_SUM - 1) // (2 * max(most, 1)) - 2, _MOST_WHOLE), 0)


@njit(cache=True, nogil=True, error_model="numpy")
def _place_packed(rays, start, count, w, edges, whole, chunk):  # type: ignore[no-untyped-def]
    """Where rays vote on a plane, on a grid of half pixels, and their shares of both rows.

    `edges`: the last column, the rows between which rays vote, the row of the first place, numbers
    of a row's whole positions, which its half ones follow, and the place for what goes nowhere.
    """
    real = np.float32
    right, above, below, origin, wide, nowhere = edges
    x0, y0, dx, dy = rays
    at, beside, left, share = chunk
    one, half, by, next_row = real(1), real(0.5), real(whole), real(65536)
    # Numbers stay floating point up to the last: vector instructions don't mix types.
    for i in range(count):
        x = x0[start + i] + dx[start + i] * w
        y = y0[start + i] + dy[start + i] * w
        # Written so that NaN fails it.
        inside = (x >= 0) & (x < right) & (y >= above) & (y < below)
        h = x + x
        position, row, column = np.floor(h), np.floor(y), np.floor(x)
        across, down = h - position, y - row
        under, upon = down * by, by - down * by
        near, far = np.floor(upon - upon * across + half), np.floor(upon * across + half)
        below_near = np.floor(under - under * across + half)
        below_far = np.floor(under * across + half)
        left[i] = np.int32(near + below_near * next_row if inside else real(0))
        share[i] = np.int32(far + below_far * next_row if inside else real(0))
        odd = position - column - column
        place = (row - origin) * (wide + wide) + column
        # The position beside a whole one is the half one, and the next whole one beside that.
        at[i] = np.int32(place + odd * wide if inside else nowhere)
        beside[i] = np.int32(place + wide + odd * (one - wide) if inside else nowhere)


@njit(cache=True, nogil=True, error_model="numpy")
def _vote_packed(rays, part, limits, w, top, height, whole, votes, chunk):  # type: ignore[no-untyped-def]
    """Votes of the rays `part` on the plane of inverse depth `w`.

    `votes`, int32, shape (rows, 2, columns), holds the row above the band's, from `top` on, those
    of the band, and one for what goes nowhere. `limits` is empty where none counts. Loops count
    without sign from where they begin: slices made for them, and what may count from the end, take
    longer than the votes.
    """
    real = np.float32
    rows, wide = len(votes) - 2, votes.shape[2]
    edges = (
        real(wide - 1), real(max(top - 1, 0)), real(min(height - 1, top + rows)), real(top - 1),
        real(wide), real((rows + 1) * 2 * wide),
    )  # fmt: skip
    flat = votes.reshape(-1)
    own = (rays[0], rays[1], rays[2], rays[3])
    at, beside, left, right = chunk
    for first in range(part[0], part[1], len(at)):
        start = np.uint64(first)
        count = np.uint64(min(part[1] - first, len(at)))
        _place_packed(own, start, count, w, edges, whole, chunk)
        if len(limits):
            for i in range(count):
                if w >= limits[start + i]:
                    left[i] = right[i] = 0
        for i in range(count):
            flat[np.uint64(at[i])] += left[i]
            flat[np.uint64(beside[i])] += right[i]


@njit(cache=True, nogil=True)
def _make_keys(votes, middle, beside, above, count, rank, keys, line):  # type: ignore[no-untyped-def]
    """Votes of pixels of a row, twice, and below them the rank, from sums of half pixels.

    A hat of one pixel is the hat of half a pixel in its middle and half of those beside it.
    `above` is how far before a row's places those of the row above are.
    """
    m, b, c = np.uint64(middle), np.uint64(beside), np.uint64(beside + 1)
    n, d, e = np.uint64(middle - above), np.uint64(beside - above), np.uint64(beside + 1 - above)
    to, own = np.uint64(line), np.int32(rank)
    low, half = np.int32(0xFFFF), np.int32(16)
    for i in range(count):
        lower = np.int32(votes[m + i] + votes[m + i] + votes[b + i] + votes[c + i])
        upper = np.int32(votes[n + i] + votes[n + i] + votes[d + i] + votes[e + i])
        total = np.int32((lower & low) + (upper >> half))
        keys[to + i] = np.int32(np.int32(total << np.int32(RANK_BITS)) | own)
