"""Loops over votes and pixels; the dense form is the sweep's twin, the tests hold both."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _copy

#: Rays that are placed before they vote.
_CHUNK = 256


def chunk() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Buffers of `_vote`: a place and two shares for each ray at hand."""
    across, down = np.empty((2, _CHUNK), np.float32)
    return np.empty(_CHUNK, np.int32), across, down


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
    rays, limits, starts, first, step, inverse, plane, chunk, best, number, votes, index
):
    """Maxima of every `step`-th band from `first` on; see `_sweep_band` for the buffers."""
    height = len(votes)
    rows = len(best)
    for b in range(first, len(starts) - 1, step):
        if starts[b] == starts[b + 1]:
            continue
        best[:] = 0
        number[:] = 0
        top = b * rows
        part = (starts[b], starts[b + 1])
        _sweep_band(rays, part, limits, inverse, top, height, plane, chunk, best, number)
        for r in range(min(rows, height - top)):
            _copy(best[r], votes[top + r])
            _copy(number[r], index[top + r])


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
def _place(rays, start, count, w, edges, stride, places, across, down):  # type: ignore[no-untyped-def]
    """Where rays vote on a plane, and their shares; `stride` behind the rows where nowhere."""
    right, above, below, origin, nowhere = edges
    x0, y0, dx, dy = rays
    # Numbers stay floating point up to the last: vector instructions don't mix types.
    for i in range(count):
        x = x0[start + i] + dx[start + i] * w
        y = y0[start + i] + dy[start + i] * w
        # Written so that NaN fails it.
        inside = (x >= 0) & (x < right) & (y >= above) & (y < below)
        left = np.floor(x)
        row = np.floor(y)
        across[i] = x - left
        down[i] = y - row
        at = (row - origin) * stride + left
        places[i] = np.int32(at if inside else nowhere)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(places, count, across, down, under, votes):  # type: ignore[no-untyped-def]
    """Bilinear votes at `places`, beside them and a row below."""
    one, next_to = votes.dtype.type(1), np.uint64(1)
    for i in range(count):
        fx = across[i]
        fy = down[i]
        gx = one - fx
        gy = one - fy
        at = np.uint64(places[i])
        votes[at] += gx * gy
        votes[at + next_to] += fx * gy
        votes[at + under] += gx * fy
        votes[at + under + next_to] += fx * fy


@njit(cache=True, nogil=True, error_model="numpy")
def _vote(rays, part, limits, w, top, height, votes, chunk):  # type: ignore[no-untyped-def]
    """Bilinear votes of the rays `part` on the plane of inverse depth `w`.

    Places first, in a loop that the compiler turns into vector instructions, then votes.
    `votes`, shape (rows, columns), holds the rows from `top` - 1 on, one below the band and two for
    what goes nowhere. `limits` is empty where none counts. Loops count without sign from where they
    begin: slices made for them, and what may count from the end, take longer than the votes.
    """
    real = votes.dtype.type
    rows = len(votes) - 2
    wide = votes.shape[1]
    stride = real(wide)
    nowhere = real(rows) * stride
    edges = (
        real(wide - 1), real(max(top - 1, 0)), real(min(height, top + rows - 1) - 1),
        real(top - 1), nowhere,
    )  # fmt: skip
    under = np.uint64(stride)
    flat = votes.reshape(-1)
    own = (rays[0], rays[1], rays[2], rays[3])
    at, fx, fy = chunk
    for first in range(part[0], part[1], len(at)):
        start = np.uint64(first)
        count = np.uint64(min(part[1] - first, len(at)))
        _place(own, start, count, w, edges, stride, at, fx, fy)
        if len(limits):
            for i in range(count):
                if w >= limits[start + i]:
                    at[i] = np.int32(nowhere)
        _add(at, count, fx, fy, under, flat)


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band(  # type: ignore[no-untyped-def]
    rays, part, limits, inverse, top, height, plane, chunk, best, number
):
    """Running maxima of a band's rows.

    `plane` holds the rows from `top` - 1 on, one below the band and two for what goes nowhere;
    `best` and `number` the band's own rows.
    """
    rows, width = best.shape
    low, high = _columns(rays, part, inverse, width)
    votes, most, which = plane.reshape(-1), best.reshape(-1), number.reshape(-1)
    for k in range(len(inverse)):
        plane[:, low:high] = 0
        _vote(rays, part, limits, inverse[k], top, height, plane, chunk)
        if low < high:
            count = np.uint64(high - low)
            for r in range(rows):
                at = r * width + low
                _keep_larger(votes, np.uint64(at + width), count, np.int32(k), most, which, at)


@njit(cache=True, nogil=True, error_model="numpy")
def _keep_larger(votes, start, count, k, most, which, at):  # type: ignore[no-untyped-def]
    """Take plane `k`, which comes after all planes before, where it has more votes than they.

    Two maxima, as what is kept in one case and written in the other becomes a masked store,
    which takes many times as long on some processors.
    """
    own = np.uint64(at)
    for i in range(count):
        seen = votes[start + i]
        was = most[own + i]
        which[own + i] = max(which[own + i], k * np.int32(seen > was))
        most[own + i] = max(seen, was)
