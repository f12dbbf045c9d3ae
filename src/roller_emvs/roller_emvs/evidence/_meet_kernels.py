"""Loops over events that look for where they meet a surface; each has a twin in the tests.

Where a ray meets the surface depends on the offset there: it is followed from the offset of one
place to that of the next for a few rounds, which settle it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._kernels import CELL_PX

_ROUNDS = 4
#: Events that are placed together.
_CHUNK = 512


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _follow(rays, begin, size, corner, per_px, surface, start, width, parts, place):  # type: ignore[no-untyped-def]
    """Follow some rays to where they meet the surface: their `place` there, offsets in `parts`.

    `surface` is the offset by place, flat, `width` to a row and `per_px` to a pixel, its first one
    at `corner`, NaN where it is unknown and in one entry more, which stands for nowhere. A ray is
    followed from `start` from one place to the next; what makes a place of rays, some at a time,
    the compiler turns into vector instructions. `parts`, shape (5, chunk), holds what the rays
    begin at, their slopes and the offset where they are.
    """
    x, y, along, across, z = parts
    nowhere = np.int32(len(surface) - 1)
    many, zero = np.int32(width), np.float32(0)
    left, top = np.float32(0.5 - corner[0]), np.float32(0.5 - corner[1])
    right, below = np.float32(width), np.float32(nowhere // width)
    for i in range(size):
        x[i] = rays[begin + i, 0] + left
        y[i] = rays[begin + i, 1] + top
        along[i] = rays[begin + i, 2]
        across[i] = rays[begin + i, 3]
        z[i] = start
    for _ in range(_ROUNDS):
        for i in range(size):
            a = (x[i] + along[i] * z[i]) * per_px
            b = (y[i] + across[i] * z[i]) * per_px
            inside = (a >= zero) & (a < right) & (b >= zero) & (b < below)
            at = np.int32(np.int32(b) * many + np.int32(a))
            place[i] = at if inside else nowhere
        for i in range(size):
            z[i] = surface[np.uint32(place[i])]


@njit(cache=True, nogil=True, error_model="numpy")
def _meet(rays, first, last, corner, offset, start, width, sums):  # type: ignore[no-untyped-def]
    """Count events, and add up their slopes along x and squares, where they meet the surface.

    `offset` is the surface on cells, as `_follow` takes it. `sums`, shape (cells, 3), flat, holds
    what is added to together.
    """
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    parts, place = np.empty((5, _CHUNK), np.float32), np.empty(_CHUNK, np.int32)
    per_px, along, z = np.float32(1.0 / CELL_PX), parts[2], parts[4]
    for begin in range(first, last, _CHUNK):
        own, size = np.uint64(begin), np.uint64(min(_CHUNK, last - begin))
        _follow(rays, own, size, corner, per_px, offset, start, width, parts, place)
        for i in range(size):
            if z[i] == z[i]:
                to, slope = three * np.uint64(place[i]), along[i]
                sums[to] += np.float32(1)
                sums[to + one] += slope
                sums[to + two] += slope * slope


@njit(cache=True, nogil=True, error_model="numpy")
def _ground(rays, corner, surface, start, width, pixel, counts):  # type: ignore[no-untyped-def]
    """Pixel in which each event meets the surface, and how many meet each.

    `surface` is the offset by pixel, as `_follow` takes it.
    """
    nowhere, one = np.int32(len(surface) - 1), np.float32(1)
    parts, place = np.empty((5, _CHUNK), np.float32), np.empty(_CHUNK, np.int32)
    z = parts[4]
    for begin in range(0, len(rays), _CHUNK):
        first, size = np.uint64(begin), np.uint64(min(_CHUNK, len(rays) - begin))
        _follow(rays, first, size, corner, one, surface, start, width, parts, place)
        for i in range(size):
            at = place[i] if z[i] == z[i] else nowhere
            pixel[first + i] = at
            counts[np.uint32(at)] += np.int32(1)


@njit(cache=True, nogil=True)
def _plane_near(rays, near, origin, step, planes, plane):  # type: ignore[no-untyped-def]
    """Plane around which each ray is searched; -1 where it meets no coarse offset.

    `near` is the coarse offset on cells, NaN where there is none.
    """
    height, width = near.shape
    right = np.float32(width)
    below = np.float32(height)
    per_px = np.float32(1.0 / CELL_PX)
    half = np.float32(0.5)
    middle = origin + step * np.float32(0.5 * (planes - 1))
    per_step = np.float32(1.0) / step
    for i in range(rays.shape[1]):
        x = rays[0, i] + half
        y = rays[1, i] + half
        z = middle
        found = np.float32(np.nan)
        for _ in range(_ROUNDS):
            a = (x + rays[2, i] * z) * per_px
            b = (y + rays[3, i] * z) * per_px
            if not ((a >= 0) & (a < right) & (b >= 0) & (b < below)):
                break
            # Unsigned, as what may be negative is checked to count from the end.
            here = near[np.uint32(b), np.uint32(a)]
            if np.isnan(here):
                break
            found = here
            if here == z:
                break
            z = here
        plane[i] = -1
        if not np.isnan(found):
            nearest = np.int32((found - origin) * per_step + half)
            plane[i] = min(max(nearest, np.int32(0)), np.int32(planes - 1))
