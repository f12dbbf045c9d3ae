"""Inner loops of the search over the paper's parameters."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _sum_levels(index, mask, sums):  # type: ignore[no-untyped-def]
    """How many masked pixels above and left of a place have at most a level.

    `sums` (height + 1, width + 1, levels) comes zeroed.
    """
    height, width = mask.shape
    levels = sums.shape[2]
    for y in range(height):
        for x in range(width):
            here = sums[y + 1, x + 1]
            above, left, corner = sums[y, x + 1], sums[y + 1, x], sums[y, x]
            for k in range(levels):
                here[k] = above[k] + left[k] - corner[k]
            if mask[y, x]:
                for k in range(index[y, x], levels):
                    here[k] += 1


@njit(cache=True, nogil=True)
def _medians(sums, rows, columns, radii, out):  # type: ignore[no-untyped-def]
    """Median of grouped data over squares of several radii about pixels of the mask."""
    height, width, levels = sums.shape[0] - 1, sums.shape[1] - 1, sums.shape[2]
    for i in range(len(rows)):
        for j in range(len(radii)):
            top, bottom = max(rows[i] - radii[j], 0), min(rows[i] + radii[j] + 1, height)
            left, right = max(columns[i] - radii[j], 0), min(columns[i] + radii[j] + 1, width)
            a, b = sums[bottom, right], sums[top, right]
            c, d = sums[bottom, left], sums[top, left]
            half = 0.5 * (a[levels - 1] - b[levels - 1] - c[levels - 1] + d[levels - 1])
            low, high = 0, levels - 1
            while low < high:
                k = (low + high) // 2
                if a[k] - b[k] - c[k] + d[k] < half:
                    low = k + 1
                else:
                    high = k
            upto = a[low] - b[low] - c[low] + d[low]
            below = 0
            if low > 0:
                below = a[low - 1] - b[low - 1] - c[low - 1] + d[low - 1]
            out[i, j] = low - 0.5 + (half - below) / (upto - below)


@njit(cache=True, nogil=True)
def _warp(rows, columns, depth, relative, intrinsics, left, top, number, out):  # type: ignore[no-untyped-def]
    """Depths as another view sees them, as `fuse_views`: to the nearest pixel, the nearer wins.

    `number` (box height, box width) is each pixel's place in `out`, or -1.
    """
    fx, fy, cx, cy = intrinsics
    height, width = number.shape
    out[:] = np.nan
    for i in range(len(rows)):
        z0 = np.float64(depth[i])
        if not z0 > 0:
            continue
        x0, y0 = (columns[i] - cx) / fx * z0, (rows[i] - cy) / fy * z0
        z = relative[2, 0] * x0 + relative[2, 1] * y0 + relative[2, 2] * z0 + relative[2, 3]
        if not z > 0:
            continue
        x = relative[0, 0] * x0 + relative[0, 1] * y0 + relative[0, 2] * z0 + relative[0, 3]
        y = relative[1, 0] * x0 + relative[1, 1] * y0 + relative[1, 2] * z0 + relative[1, 3]
        u, v = fx * x / z + cx + 0.5 - left, fy * y / z + cy + 0.5 - top
        if u >= 0 and u < width and v >= 0 and v < height:
            k = number[int(v), int(u)]
            if k >= 0 and not out[k] <= z:
                out[k] = z


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _tally(depth, truth, normalised, counts, errors, points):  # type: ignore[no-untyped-def]
    """Errors of the weighted means of all weights, as `fuse_views` makes them.

    `depth` (views, pixels) is NaN where a view has none; `normalised` (sets, views, choices) are
    the weights for each set of views, `counts` (sets, choices) whether it gives a mean.
    """
    views, count = depth.shape
    choices = counts.shape[1]
    seen = np.zeros(len(counts), np.int64)
    total = np.empty(choices)
    for i in range(count):
        found = 0
        for k in range(views):
            if depth[k, i] > 0:
                found += 1 << k
        if found == 0:
            continue
        seen[found] += 1
        total[:] = 0.0
        for k in range(views):
            if depth[k, i] > 0:
                # Relative to the truth, so that sums lose nothing.
                z = np.float64(depth[k, i]) - truth[i]
                for j in range(choices):
                    total[j] += normalised[found, k, j] * z
        for j in range(choices):
            errors[j] += abs(total[j])
    for found in range(len(counts)):
        for j in range(choices):
            points[j] += seen[found] * counts[found, j]
