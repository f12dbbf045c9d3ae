"""Loops over events and rays; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _place(x, y, t, rays, t0, t1, p0, p1, r0, r1, z, out):  # type: ignore[no-untyped-def]
    """Where rays meet the plane z, and their slopes; NaN for rays that don't.

    `rays` holds the direction (x, y at unit depth) of every pixel. Between the poses at t0 and t1
    position and rotation go linearly: a pose interval turns by far less than it takes to notice.
    """
    for i in range(len(x)):
        f = np.float64(t[i] - t0) / np.float64(t1 - t0)
        a = np.float64(rays[y[i], x[i], 0])
        b = np.float64(rays[y[i], x[i], 1])
        d0 = (r0[0, 0] * a + r0[0, 1] * b + r0[0, 2]) * (1 - f)
        d1 = (r0[1, 0] * a + r0[1, 1] * b + r0[1, 2]) * (1 - f)
        d2 = (r0[2, 0] * a + r0[2, 1] * b + r0[2, 2]) * (1 - f)
        d0 += (r1[0, 0] * a + r1[0, 1] * b + r1[0, 2]) * f
        d1 += (r1[1, 0] * a + r1[1, 1] * b + r1[1, 2]) * f
        d2 += (r1[2, 0] * a + r1[2, 1] * b + r1[2, 2]) * f
        if not d2 > 1e-6:
            out[0, i] = np.nan
            out[1, i] = np.nan
            out[2, i] = np.nan
            out[3, i] = np.nan
            continue
        sx = d0 / d2
        sy = d1 / d2
        away = z - (p0[2] + f * (p1[2] - p0[2]))
        out[0, i] = p0[0] + f * (p1[0] - p0[0]) + sx * away
        out[1, i] = p0[1] + f * (p1[1] - p0[1]) + sy * away
        out[2, i] = sx
        out[3, i] = sy


@njit(cache=True, nogil=True)
def _span(rays, steepest):  # type: ignore[no-untyped-def]
    """Least and most x of the rays and the largest slope along x.

    Rays that lean more than `steepest` are left out, and their x is made NaN.
    """
    low = np.inf
    high = -np.inf
    most = 0.0
    for i in range(rays.shape[1]):
        slope = abs(rays[2, i])
        # Written so that NaN fails it.
        if not slope <= steepest:
            rays[0, i] = np.nan
            continue
        low = min(low, rays[0, i])
        high = max(high, rays[0, i])
        most = max(most, slope)
    return low, high, most


@njit(cache=True, nogil=True)
def _find_blocks(rays, reach, length, ends, first, last, counts):  # type: ignore[no-untyped-def]
    """First and last block that each ray can reach, of those from `ends[0]` to `ends[1]`.

    Last before first where there is none. `counts`, shape (blocks,), must be zero.
    """
    for i in range(rays.shape[1]):
        first[i] = 1
        last[i] = 0
        x = rays[0, i]
        if np.isnan(x):
            continue
        first[i] = max(np.int64(np.floor((x - reach) / length)), ends[0]) - ends[0]
        last[i] = min(np.int64(np.floor((x + reach) / length)), ends[1]) - ends[0]
        for k in range(first[i], last[i] + 1):
            counts[k] += 1


@njit(cache=True, nogil=True)
def _list_blocks(  # type: ignore[no-untyped-def]
    rays, polarity, t, first, last, starts, place, out, out_polarity, times
):
    """Rays by block, x from the block's start on; and times of each block's first and last.

    `place` holds where each block's rays begin in `out`, and is moved on; `times` begin with the
    largest and the smallest there are.
    """
    for i in range(rays.shape[1]):
        for k in range(first[i], last[i] + 1):
            n = place[k]
            out[n, 0] = rays[0, i] - starts[k]
            for c in range(1, 4):
                out[n, c] = rays[c, i]
            out_polarity[n] = polarity[i]
            times[k, 0] = min(times[k, 0], t[i])
            times[k, 1] = max(times[k, 1], t[i])
            place[k] += 1


@njit(cache=True, nogil=True)
def _rows(rays, polarity):  # type: ignore[no-untyped-def]
    """Least and most y of rays, and how many are of OFF events."""
    low = np.float32(np.inf)
    high = np.float32(-np.inf)
    off = 0
    for i in range(len(rays)):
        low = min(low, rays[i, 1])
        high = max(high, rays[i, 1])
        off += polarity[i] == 0
    return low, high, off


@njit(cache=True, nogil=True)
def _to_pixels(rays, polarity, corner, pixel, place, out):  # type: ignore[no-untyped-def]
    """Rays in pixels from a corner (x, y), OFF and ON from `place` on, which is moved on."""
    for i in range(len(rays)):
        p = 1 if polarity[i] > 0 else 0
        n = place[p]
        out[n, 0] = (rays[i, 0] - corner[0]) / pixel
        out[n, 1] = (rays[i, 1] - corner[1]) / pixel
        out[n, 2] = rays[i, 2] / pixel
        out[n, 3] = rays[i, 3] / pixel
        place[p] += 1
