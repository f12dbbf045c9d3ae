"""Loops over votes and pixels; the dense form is the sweep's twin, the tests hold both."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

#: Rays that are placed before they vote.
_CHUNK = 256


def chunk(dtype: npt.DTypeLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Buffers of `_vote`: two places and two shares for each ray at hand."""
    places = (np.empty(_CHUNK, np.int32), np.empty(_CHUNK, np.int32))
    return *places, np.empty(_CHUNK, dtype), np.empty(_CHUNK, dtype)


@njit(cache=True, nogil=True, error_model="numpy")
def _vote_plane(rays, limits, w, plane):  # type: ignore[no-untyped-def]
    """Bilinear votes on the plane of inverse depth `w`."""
    height, width = plane.shape
    one = plane.dtype.type(1)
    for i in range(len(rays)):
        x = rays[i, 0] + rays[i, 2] * w
        y = rays[i, 1] + rays[i, 3] * w
        # Written so that NaN fails it.
        if x >= 0 and x < width - 1 and y >= 0 and y < height - 1 and w < limits[i]:
            xi = int(x)
            yi = int(y)
            fx = x - plane.dtype.type(xi)
            fy = y - plane.dtype.type(yi)
            gx = one - fx
            gy = one - fy
            plane[yi, xi] += gx * gy
            plane[yi, xi + 1] += fx * gy
            plane[yi + 1, xi] += gx * fy
            plane[yi + 1, xi + 1] += fx * fy


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_bands(  # type: ignore[no-untyped-def]
    rays, limits, starts, first, step, tiles, inverse, plane, chunk, best, number, votes, index
):
    """Maxima of every `step`-th band from `first` on; see `_sweep_band` for the buffers."""
    height = len(votes)
    rows = len(best)
    for b in range(first, len(starts) - 1, step):
        if tiles and starts[b] == starts[b + 1]:
            continue
        best[:] = 0
        number[:] = 0
        top = b * rows
        part = (starts[b], starts[b + 1])
        _sweep_band(rays, part, limits, inverse, top, height, plane, chunk, best, number)
        for r in range(min(rows, height - top)):
            votes[top + r] = best[r]
            index[top + r] = number[r]


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_bands_views(  # type: ignore[no-untyped-def]
    rays, limits, starts, first, step, tiles, inverse, halves, pad, hats, chunk, best, number,
    votes, index,
):  # fmt: skip
    """As `_sweep_bands`, for several views."""
    height = votes.shape[1]
    rows = best.shape[1]
    for b in range(first, len(starts) - 1, step):
        if tiles and starts[b] == starts[b + 1]:
            continue
        best[:] = 0
        number[:] = 0
        hats[:] = 0
        top = b * rows
        part = (starts[b], starts[b + 1])
        _sweep_band_views(
            rays, part, limits, inverse, halves, top, height, pad, hats, chunk, best, number
        )
        for j in range(len(votes)):
            for r in range(min(rows, height - top)):
                votes[j, top + r] = best[j, r]
                index[j, top + r] = number[j, r]


@njit(cache=True, nogil=True, error_model="numpy")
def _columns(rays, part, inverse, width):  # type: ignore[no-untyped-def]
    """First column that rays vote on over all planes, and the one after the last."""
    low = width
    high = 0
    near = inverse[0]
    far = inverse[-1]
    for i in range(part[0], part[1]):
        a = rays[0, i] + rays[2, i] * near
        b = rays[0, i] + rays[2, i] * far
        # Written so that NaN changes nothing; one more column for rounding.
        if min(a, b) - 1 < low:
            low = int(max(min(a, b) - 1, 0.0))
        if max(a, b) + 3 > high:
            high = int(min(max(a, b) + 3, np.float64(width)))
    return low, high


@njit(cache=True, nogil=True, error_model="numpy")
def _place(x0, y0, dx, dy, w, edges, stride, places, across, down):  # type: ignore[no-untyped-def]
    """Where rays vote on a plane, and their shares; `stride` behind the rows where nowhere."""
    right, above, below, origin, nowhere = edges
    # Numbers stay floating point up to the last: vector instructions don't mix types.
    for i in range(len(x0)):
        x = x0[i] + dx[i] * w
        y = y0[i] + dy[i] * w
        # Written so that NaN fails it.
        inside = (x >= 0) & (x < right) & (y >= above) & (y < below)
        left = np.floor(x)
        row = np.floor(y)
        across[i] = x - left
        down[i] = y - row
        at = (row - origin) * stride + left
        places[i] = np.int32(at if inside else nowhere)


@njit(cache=True, nogil=True, error_model="numpy")
def _place_halves(  # type: ignore[no-untyped-def]
    x0, y0, dx, dy, w, edges, stride, places, besides, across, down
):
    """As `_place`, on a grid of half pixels: a row's whole positions, then its half ones."""
    right, above, below, origin, nowhere = edges
    half = stride * x0.dtype.type(0.5)
    for i in range(len(x0)):
        x = x0[i] + dx[i] * w
        y = y0[i] + dy[i] * w
        inside = (x >= 0) & (x < right) & (y >= above) & (y < below)
        h = x + x
        left = np.floor(h)
        row = np.floor(y)
        across[i] = h - left
        down[i] = y - row
        whole = np.floor(x)
        odd = left - whole - whole
        at = (row - origin) * stride + whole
        # The position beside a whole one is the half one, and the next whole one beside that.
        places[i] = np.int32(at + odd * half if inside else nowhere)
        besides[i] = np.int32(at + half + odd * (x0.dtype.type(1) - half) if inside else nowhere)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(places, besides, next_to, across, down, under, votes):  # type: ignore[no-untyped-def]
    """Bilinear votes at `places`, `next_to` further on from `besides`, and a row below."""
    one = votes.dtype.type(1)
    for i in range(len(places)):
        fx = across[i]
        fy = down[i]
        gx = one - fx
        gy = one - fy
        at = np.uint64(places[i])
        beside = np.uint64(besides[i]) + next_to
        votes[at] += gx * gy
        votes[beside] += fx * gy
        votes[at + under] += gx * fy
        votes[beside + under] += fx * fy


@njit(cache=True, nogil=True, error_model="numpy")
def _vote(rays, part, limits, w, top, height, halves, votes, chunk):  # type: ignore[no-untyped-def]
    """Bilinear votes of the rays `part` on the plane of inverse depth `w`.

    Places first, in a loop that the compiler turns into vector instructions, then votes.
    `votes`, shape (rows, columns) or with `halves` (rows, 2, columns), holds the rows from
    `top` - 1 on, one below the band and two for what goes nowhere. `limits` is empty where none
    counts.
    """
    real = votes.dtype.type
    rows = len(votes) - 2
    wide = votes.shape[-1]
    stride = real(2 * wide if halves else wide)
    nowhere = real(rows) * stride
    edges = (
        real(wide - 1), real(max(top - 1, 0)), real(min(height, top + rows - 1) - 1),
        real(top - 1), nowhere,
    )  # fmt: skip
    flat = votes.reshape(-1)
    places, besides, across, down = chunk
    for start in range(part[0], part[1], len(places)):
        end = min(start + len(places), part[1])
        n = end - start
        at, beside, fx, fy = places[:n], besides[:n], across[:n], down[:n]
        x, y = rays[0, start:end], rays[1, start:end]
        dx, dy = rays[2, start:end], rays[3, start:end]
        if halves:
            _place_halves(x, y, dx, dy, w, edges, stride, at, beside, fx, fy)
        else:
            _place(x, y, dx, dy, w, edges, stride, at, fx, fy)
        if len(limits):
            for i in range(n):
                if w >= limits[start + i]:
                    at[i] = np.int32(nowhere)
                    beside[i] = np.int32(nowhere)
        if halves:
            _add(at, beside, np.uint64(0), fx, fy, np.uint64(stride), flat)
        else:
            _add(at, at, np.uint64(1), fx, fy, np.uint64(stride), flat)


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band(  # type: ignore[no-untyped-def]
    rays, part, limits, inverse, top, height, plane, chunk, best, number
):
    """Running maxima of a band's rows.

    `plane` holds the rows from `top` - 1 on, one below the band and two for what goes nowhere;
    `best` and `number` the band's own rows.
    """
    width = plane.shape[1]
    low, high = _columns(rays, part, inverse, width)
    for k in range(len(inverse)):
        plane[:, low:high] = 0
        _vote(rays, part, limits, inverse[k], top, height, False, plane, chunk)
        for r in range(len(best)):
            _keep_larger(
                plane[r + 1, low:high], np.int32(k), best[r, low:high], number[r, low:high]
            )


@njit(cache=True, nogil=True, error_model="numpy")
def _keep_larger(seen, k, best, number):  # type: ignore[no-untyped-def]
    """Take plane `k`, which comes after all planes before, where it has more votes than they.

    Two maxima, as what is kept in one case and written in the other becomes a masked store,
    which takes many times as long on some processors.
    """
    for x in range(len(best)):
        votes = seen[x]
        was = best[x]
        number[x] = max(number[x], k * np.int32(votes > was))
        best[x] = max(votes, was)


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band_views(  # type: ignore[no-untyped-def]
    rays, part, limits, inverse, halves, top, height, pad, votes, chunk, best, number
):
    """Running maxima of a band's rows in views shifted by halves of a pixel.

    Votes are hats on a grid of half pixels, shape (2, rows, 2, columns): of two planes, its whole
    and its half positions, `pad` pixels wider than the image on either side. A hat of one pixel
    is the sum of the hat of half a pixel in its middle and half of those beside it, so the views'
    votes are exactly bilinear. Two planes at a time, as the maxima are what takes the way to
    memory.
    """
    planes = len(inverse)
    views, own, width = best.shape
    low, high = _columns(rays, part, inverse, votes.shape[3])
    for k in range(0, planes, 2):
        # The second of an odd number of planes gets no votes.
        last = min(k + 1, planes - 1)
        for n in range(2):
            votes[n, :, :, low:high] = 0
            if k + n < planes:
                _vote(rays, part, limits, inverse[k + n], top, height, True, votes[n], chunk)
        for r in range(own):
            for j in range(views):
                a = (halves[j, k] >> 1) + pad
                b = (halves[j, last] >> 1) + pad
                # The view's columns that see some of the votes; beyond them there are none.
                begin = max(low - max(a, b), 0)
                end = min(high - min(a, b), width)
                if begin < end:
                    _keep_larger_hats(
                        _hat(votes[0, r + 1], halves[j, k] & 1, a + begin, a + end),
                        _hat(votes[1, r + 1], halves[j, last] & 1, b + begin, b + end),
                        np.int32(k), best[j, r, begin:end], number[j, r, begin:end],
                    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _hat(row, odd, first, last):  # type: ignore[no-untyped-def]
    """Votes in the middle of whole (or half, `odd`) positions, and those beside them."""
    # Half positions lie between whole ones: that of x is at x + 1/2.
    return row[odd, first:last], row[1 - odd, first - 1 + odd : last + odd]


@njit(cache=True, nogil=True, error_model="numpy")
def _keep_larger_hats(first, second, k, best, number):  # type: ignore[no-untyped-def]
    """As `_keep_larger`, of planes k and k + 1, whose votes are put together from hats."""
    middle, beside = first
    next_middle, next_beside = second
    half = middle.dtype.type(0.5)
    after = k + np.int32(1)
    for x in range(len(best)):
        votes = middle[x] + half * (beside[x] + beside[x + 1])
        others = next_middle[x] + half * (next_beside[x] + next_beside[x + 1])
        was = best[x]
        more = max(votes, was)
        number[x] = max(number[x], k * np.int32(votes > was), after * np.int32(others > more))
        best[x] = max(others, more)
