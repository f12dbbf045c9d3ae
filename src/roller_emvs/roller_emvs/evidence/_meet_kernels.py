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


@njit(cache=True, nogil=True)
def _meet(rays, first, last, corner, offset, start, sums):  # type: ignore[no-untyped-def]
    """Count events, and add up their slopes along x and squares, where they meet the surface.

    `offset` is the surface on cells, NaN where unknown; a ray that meets none counts nowhere. Its
    first pixel is at `corner`, column and row, of what the rays are in.
    `sums`, shape (rows, columns, 3), holds what is added to together.
    """
    height, width = offset.shape
    right = np.float32(width)
    below = np.float32(height)
    per_px = np.float32(1.0 / CELL_PX)
    left, top = np.float32(0.5 - corner[0]), np.float32(0.5 - corner[1])
    for i in range(first, last):
        x = rays[i, 0] + left
        y = rays[i, 1] + top
        slope = rays[i, 2]
        z = start
        row = np.uint32(0)
        column = np.uint32(0)
        met = False
        for _ in range(_ROUNDS):
            a = (x + slope * z) * per_px
            b = (y + rays[i, 3] * z) * per_px
            met = (a >= 0) & (a < right) & (b >= 0) & (b < below)
            if not met:
                break
            # Unsigned, as what may be negative is checked to count from the end.
            row = np.uint32(b)
            column = np.uint32(a)
            here = offset[row, column]
            met = not np.isnan(here)
            if not met or z == here:
                break
            z = here
        if met:
            sums[row, column, 0] += np.float32(1)
            sums[row, column, 1] += slope
            sums[row, column, 2] += slope * slope


@njit(cache=True, nogil=True, error_model="numpy")
def _ground(rays, corner, surface, start, width, pixel, counts):  # type: ignore[no-untyped-def]
    """Pixel in which each event meets the surface, and how many meet each.

    `surface` is the offset by pixel, flat, its first one at `corner` as in `_meet`, NaN where it is
    unknown and in one entry more, which stands for nowhere. A ray is followed from `start` from
    one place to the next; what makes a place of rays, some at a time, the compiler turns into
    vector instructions.
    """
    nowhere = np.int32(len(surface) - 1)
    many, zero = np.int32(width), np.float32(0)
    left, top = np.float32(0.5 - corner[0]), np.float32(0.5 - corner[1])
    right, below = np.float32(width), np.float32(nowhere // width)
    x, y, along, across, z = np.empty((5, _CHUNK), np.float32)
    place = np.empty(_CHUNK, np.int32)
    for begin in range(0, len(rays), _CHUNK):
        first, size = np.uint64(begin), np.uint64(min(_CHUNK, len(rays) - begin))
        for i in range(size):
            x[i] = rays[first + i, 0] + left
            y[i] = rays[first + i, 1] + top
            along[i] = rays[first + i, 2]
            across[i] = rays[first + i, 3]
            z[i] = start
        for _ in range(_ROUNDS):
            for i in range(size):
                a = x[i] + along[i] * z[i]
                b = y[i] + across[i] * z[i]
                inside = (a >= zero) & (a < right) & (b >= zero) & (b < below)
                at = np.int32(np.int32(b) * many + np.int32(a))
                place[i] = at if inside else nowhere
            for i in range(size):
                z[i] = surface[np.uint32(place[i])]
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
