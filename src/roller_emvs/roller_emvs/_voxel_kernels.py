"""Loops over points and voxels of the stitched cloud; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core import numba_start  # noqa: F401 (before a kernel runs)


@njit(cache=True, nogil=True, error_model="numpy")
def _place(depth, confidence, sigma, intrinsics, pose, points, sure, spread):  # type: ignore[no-untyped-def]
    """Points in base of a depth map's pixels that are sure of something; how many.

    depth, confidence, sigma: float32 (rows, columns); intrinsics: fx, fy, cx, cy; pose: (4, 4).
    points: float64 (n, 3), sure, spread: float32 (n,), written to, n of all pixels at most.
    """
    fx, fy, cx, cy = intrinsics
    n = np.uint64(0)
    rows, columns = depth.shape
    for r in range(rows):
        for c in range(columns):
            if not (np.isfinite(depth[r, c]) and confidence[r, c] >= 0):  # NaN isn't
                continue
            z = np.float64(depth[r, c])
            x = (c - cx) / fx * z
            y = (r - cy) / fy * z
            for k in range(3):
                turned = x * pose[k, 0] + y * pose[k, 1] + z * pose[k, 2]
                points[n, k] = turned + pose[k, 3]
            sure[n] = confidence[r, c]
            spread[n] = sigma[r, c]
            n += np.uint64(1)
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _number(points, confidence, sigma, furthest, origin, axes, edges, bits, keys):  # type: ignore[no-untyped-def]
    """Keys of the voxels that points lie in, -1 where there is none; how many have one.

    axes: float64 (3, 3), edges of a voxel as columns, and `edges` their lengths; bits: int64 (3,),
    of the three indices in a key, see `cell_key`.
    """
    count = 0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        # Written so that NaN fails it.
        good = abs(x) < furthest and abs(y) < furthest and abs(z) < furthest
        if not (good and np.isfinite(confidence[i]) and np.isfinite(sigma[i])):
            keys[i] = -1
            continue
        x, y, z = x - origin[0], y - origin[1], z - origin[2]
        key = np.int64(0)
        for k in range(3):
            along = x * axes[0, k] + y * axes[1, k] + z * axes[2, k]
            cell = np.int64(np.floor(along / edges[k]))
            size = np.int64(1) << bits[k]
            key = (key << bits[k]) | ((cell + (size >> 1)) & (size - 1))
        keys[i] = key
        count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _sum(order, keys, points, confidence, sigma, origin, least, turn, unique, sums):  # type: ignore[no-untyped-def]
    """Sums of the points of each voxel, as `VoxelMap` keeps them; how many voxels.

    order: int64 (m,), points by the keys of their voxels; unique: int64 (m,) and sums: float64
    (m, 7), written to. Points of a voxel are summed in the order in which they came.
    """
    n = -1
    start = 0
    while start < len(order):
        key = keys[order[start]]
        end = start + 1
        while end < len(order) and keys[order[end]] == key:
            end += 1
        for i in range(start + 1, end):  # a handful: sorted by insertion
            own = order[i]
            j = i
            while j > start and order[j - 1] > own:
                order[j] = order[j - 1]
                j -= 1
            order[j] = own
        n += 1
        unique[n] = key
        sums[n] = 0.0
        for i in order[start:end]:
            spread = max(np.float64(sigma[i]), least)
            weight = 1.0 / (spread * spread)
            sums[n, 0] += weight
            for k in range(3):
                sums[n, 1 + k] += (points[i, k] - origin[k]) * weight
            sums[n, 4] += confidence[i] * weight
            sums[n, 5] += sigma[i] * weight
        sums[n, 6] = turn
        start = end
    return n + 1


@njit(cache=True, nogil=True)
def _join(keys, sums, more_keys, more_sums, out_keys, out_sums):  # type: ignore[no-untyped-def]
    """Two lists of voxels as one, all sorted by key; how many.

    What both have is added up, but for the last column: that is of the second.
    """
    i = j = n = 0
    while i < len(keys) or j < len(more_keys):
        old = j == len(more_keys) or (i < len(keys) and keys[i] <= more_keys[j])
        new = i == len(keys) or (j < len(more_keys) and more_keys[j] <= keys[i])
        if old:
            out_keys[n] = keys[i]
            for k in range(7):
                out_sums[n, k] = sums[i, k]
            i += 1
        else:
            out_keys[n] = more_keys[j]
            for k in range(6):
                out_sums[n, k] = 0.0
        if new:
            for k in range(6):
                out_sums[n, k] += more_sums[j, k]
            out_sums[n, 6] = more_sums[j, 6]
            j += 1
        n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _near(sums, origin, low, high, points):  # type: ignore[no-untyped-def]
    """Means of the voxels within a box, written to `points`, float64 (n, 3); how many."""
    n = np.uint64(0)
    for i in range(len(sums)):
        inside = True
        for k in range(3):
            mean = sums[i, 1 + k] / sums[i, 0] + origin[k]
            points[n, k] = mean
            inside &= low[k] <= mean <= high[k]
        n += np.uint64(inside)
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _see(sums, origin, intrinsics, shape, to_camera, seen):  # type: ignore[no-untyped-def]
    """Whether a camera's image, `shape` its rows and columns, shows the means of voxels."""
    fx, fy, cx, cy = intrinsics
    m = to_camera
    for i in range(len(sums)):
        x = sums[i, 1] / sums[i, 0] + origin[0]
        y = sums[i, 2] / sums[i, 0] + origin[1]
        z = sums[i, 3] / sums[i, 0] + origin[2]
        depth = max(x * m[2, 0] + y * m[2, 1] + z * m[2, 2] + m[2, 3], 1e-9)
        u = fx * (x * m[0, 0] + y * m[0, 1] + z * m[0, 2] + m[0, 3]) / depth + cx
        v = fy * (x * m[1, 0] + y * m[1, 1] + z * m[1, 2] + m[1, 3]) / depth + cy
        seen[i] = 0 <= u < shape[1] and 0 <= v < shape[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(points, which, near, moments, counts):  # type: ignore[no-untyped-def]
    """Second central moments of the neighbours of some points.

    which: int64 (m,); near: int64 (m, k), numbers of their neighbours, len(points) where there is
    none; moments: float64 (m, 3, 3) and counts: int64 (m,), written to.
    """
    local = np.empty(3)
    mean = np.empty(3)
    second = np.empty((3, 3))
    for i in range(len(which)):
        mean[:] = 0.0
        second[:] = 0.0
        count = 0
        for j in near[i]:
            if j == len(points):
                continue
            count += 1
            for a in range(3):
                local[a] = points[j, a] - points[which[i], a]
                mean[a] += local[a]
            for a in range(3):
                for b in range(a + 1):
                    second[a, b] += local[a] * local[b]
        counts[i] = count
        for a in range(3):
            for b in range(a + 1):
                value = second[a, b] / count - (mean[a] / count) * (mean[b] / count)
                moments[i, a, b] = moments[i, b, a] = value


@njit(cache=True, nogil=True, error_model="numpy")
def _settle(keys, sums, keep, origin, points, sure, spread):  # type: ignore[no-untyped-def]
    """Move the voxels to keep to the front, and write the means of the others; how many stay."""
    n = gone = np.uint64(0)
    for i in range(len(keys)):
        if keep[i]:
            keys[n] = keys[i]
            for k in range(7):
                sums[n, k] = sums[i, k]
            n += np.uint64(1)
            continue
        weight = sums[i, 0]
        for k in range(3):
            points[gone, k] = sums[i, 1 + k] / weight + origin[k]
        sure[gone] = sums[i, 4] / weight
        spread[gone] = sums[i, 5] / weight
        gone += np.uint64(1)
    return n
