"""Loops over events and cells; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

#: Pixels of the strip to one cell of the grid that evidence is summed on.
GRID_PX = 4


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


@njit(cache=True, nogil=True, error_model="numpy")
def _vote(rays, first, last, shift, image):  # type: ignore[no-untyped-def]
    """Bilinear votes of rays (x, y, slopes in px, shape (n, 4)) on the plane at `shift`."""
    height, width = image.shape
    right = np.float32(width - 1)
    bottom = np.float32(height - 1)
    for i in range(first, last):
        x = rays[i, 0] + rays[i, 2] * shift
        y = rays[i, 1] + rays[i, 3] * shift
        # Written so that NaN fails it.
        if x >= 0 and x < right and y >= 0 and y < bottom:
            xi = int(x)
            yi = int(y)
            fx = x - np.float32(xi)
            fy = y - np.float32(yi)
            gx = np.float32(1) - fx
            gy = np.float32(1) - fy
            image[yi, xi] += gx * gy
            image[yi, xi + 1] += fx * gy
            image[yi + 1, xi] += gx * fy
            image[yi + 1, xi + 1] += fx * fy


@njit(cache=True, nogil=True, fastmath=True)
def _add_energy(votes, energy):  # type: ignore[no-untyped-def]
    """Squared Sobel derivative along x, added up over the cells of the grid."""
    height, width = votes.shape
    for y in range(1, height - 1):
        above, here, below = votes[y - 1], votes[y], votes[y + 1]
        row = energy[y // GRID_PX]
        for cell in range(row.size):
            total = np.float32(0)
            for x in range(max(cell * GRID_PX, 1), min(cell * GRID_PX + GRID_PX, width - 1)):
                slope = (
                    (above[x + 1] - above[x - 1])
                    + np.float32(2) * (here[x + 1] - here[x - 1])
                    + (below[x + 1] - below[x - 1])
                )
                total += slope * slope
            row[cell] += total


@njit(cache=True, nogil=True)
def _find_peak(scores, first, last, peak, contrast):  # type: ignore[no-untyped-def]
    """Highest score among planes first..last of each cell, between planes.

    NaN where it lies at an end of the search or of the range: the top was not seen.
    """
    n, height, width = scores.shape
    for i in range(height):
        for j in range(width):
            peak[i, j] = np.nan
            contrast[i, j] = 0
            low = max(first[i, j], 1)
            high = min(last[i, j], n - 2)
            if high < low:
                continue
            best = low
            for k in range(low, high + 1):
                if scores[k, i, j] > scores[best, i, j]:
                    best = k
            top = scores[best, i, j]
            left = scores[best - 1, i, j]
            right = scores[best + 1, i, j]
            if not (top > 0 and top >= left and top >= right):
                continue
            bend = left - 2 * top + right
            peak[i, j] = best + (0.5 * (left - right) / bend if bend < 0 else 0.0)
            total = np.float64(0)
            for k in range(n):
                total += scores[k, i, j]
            contrast[i, j] = 1 - total / (n * top)


@njit(cache=True, nogil=True)
def _warp(rays, first, last, depth, start, support):  # type: ignore[no-untyped-def]
    """Count events at the pixels where they meet the surface `depth` (NaN: unknown)."""
    height, width = depth.shape
    for i in range(first, last):
        z = start
        x = -1
        y = -1
        # Where a ray meets the surface depends on the depth there: a few rounds settle it.
        for _ in range(4):
            a = rays[i, 0] + rays[i, 2] * z
            b = rays[i, 1] + rays[i, 3] * z
            if not (a >= -0.5 and a < width - 0.5 and b >= -0.5 and b < height - 0.5):
                x = -1
                break
            x = int(a + 0.5)
            y = int(b + 0.5)
            if np.isnan(depth[y, x]):
                break
            z = depth[y, x]
        if x >= 0 and not np.isnan(depth[y, x]):
            support[y, x] += 1
