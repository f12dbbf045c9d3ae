"""Depth of several reference views in one: warp, then average (paper, eq. fusion)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose
from roller_emvs.rays import F32, I64


@dataclass(frozen=True)
class ViewDepth:
    """Depth from one reference view, at the pixels that have one."""

    #: Flat indices in the view's image. Shape (n,).
    pixels: I64
    #: Metres, 0–1. Shape (n,).
    depth: F32
    confidence: F32
    #: Camera in base. Shape (4, 4).
    pose: F64
    #: Weight in the fusion.
    weight: float


def warp_view(view: ViewDepth, target: F64, camera: Camera) -> ViewDepth:
    """Points of one view as seen from another (paper, eqs. back-projection to re-projection).

    A point goes to the nearest pixel, where others may lie too; those that leave the image are left
    out.

    Parameters
    ----------
    view : ViewDepth
        Depth and confidence with their pose.
    target : ndarray of float64, shape (4, 4)
        Camera in base to warp into.
    camera : Camera
        Intrinsics.
    """
    if np.array_equal(view.pose, target):
        return view
    pixels, depth = np.empty_like(view.pixels), np.empty_like(view.depth)
    confidence, shape = np.empty_like(view.confidence), (camera.height, camera.width)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    relative = inverse_pose(target) @ view.pose
    own = (view.pixels, view.depth, view.confidence)
    n = _warp(*own, intrinsics, relative, shape, pixels, depth, confidence)
    return replace(view, pixels=pixels[:n], depth=depth[:n], confidence=confidence[:n], pose=target)


def fuse_views(views: Sequence[ViewDepth], target: F64, camera: Camera) -> tuple[F32, F32]:
    """Weighted mean of all views in the target view.

    Where two points of a view meet the nearer one hides the other. Where a view has no depth the
    others' weights are renormalised to one.

    Parameters
    ----------
    views : sequence of ViewDepth
        At least one.
    target : ndarray of float64, shape (4, 4)
        Camera in base.
    camera : Camera
        Intrinsics.

    Returns
    -------
    depth, confidence : ndarray of float32, shape (height, width)
        NaN where no view has a depth.
    """
    return weighted_mean([warp_view(view, target, camera) for view in views], camera)


def weighted_mean(warped: Sequence[ViewDepth], camera: Camera) -> tuple[F32, F32]:
    """Weighted mean of views that were warped into one; see `fuse_views`."""
    shape = (camera.height, camera.width)
    depth, confidence = (np.full(shape, np.float32(np.nan)) for _ in range(2))
    most = sum(len(view.pixels) for view in warped)
    # Few pixels hold anything: each has a place in lists.
    place, pixels = np.zeros(camera.height * camera.width, np.int32), np.empty(most, np.int64)
    sums, nearest = np.empty((most, 3), np.float32), np.empty((most, 2), np.float32)
    latest, n = np.empty(most, np.int32), 0
    for k, view in enumerate(warped):
        n = _gather(
            view.pixels, view.depth, view.confidence, k, n, place, pixels, latest, nearest, sums
        )
        _add(k, n, view.weight, latest, nearest, sums)
    _mean(pixels, n, sums, depth.reshape(-1), confidence.reshape(-1))
    return depth, confidence


@njit(cache=True, nogil=True)
def _gather(pixels, depth, confidence, view, n, place, found, latest, nearest, sums):  # type: ignore[no-untyped-def]
    """Nearest depth of a view, and its confidence, at each pixel that has one.

    Of the first `n` entries of lists some view told before: their pixels are `found`, `place` is
    where each pixel's entry is, from 1 on, 0 for none. `latest` is the view that `nearest`, depth
    and confidence, is of. Returns how many entries there are now, new ones with `sums` of 0.
    """
    for i in range(len(pixels)):
        at = place[pixels[i]] - 1
        if at < 0:
            at = n
            n += 1
            place[pixels[i]] = n
            found[at], latest[at] = pixels[i], -1
            sums[at] = 0
        if latest[at] != view or depth[i] < nearest[at, 0]:
            latest[at] = view
            nearest[at, 0], nearest[at, 1] = depth[i], confidence[i]
    return n


@njit(cache=True, nogil=True)
def _add(view, n, weight, latest, nearest, sums):  # type: ignore[no-untyped-def]
    """Add a view's weight, and its depth and confidence times that, where it has one."""
    for i in range(n):
        if latest[i] == view:
            sums[i, 0] += weight
            sums[i, 1] += weight * nearest[i, 0]
            sums[i, 2] += weight * nearest[i, 1]


@njit(cache=True, nogil=True, error_model="numpy")
def _mean(pixels, n, sums, depth, confidence):  # type: ignore[no-untyped-def]
    """Means by pixel; NaN where the weight is zero."""
    for i in range(n):
        depth[pixels[i]] = sums[i, 1] / sums[i, 0]
        confidence[pixels[i]] = sums[i, 2] / sums[i, 0]


@njit(cache=True, nogil=True)
def _warp(  # type: ignore[no-untyped-def]
    pixels, depth, confidence, intrinsics, relative, shape, to, far, sure
):
    """Pixels and depths of a view's points where another sees them, and how many it sees.

    `relative` is the view in the other.
    """
    fx, fy, cx, cy = intrinsics
    height, width = shape
    n = 0
    for i in range(len(pixels)):
        z = np.float64(depth[i])
        x = (pixels[i] % width - cx) / fx * z
        y = (pixels[i] // width - cy) / fy * z
        ahead = relative[2, 0] * x + relative[2, 1] * y + relative[2, 2] * z + relative[2, 3]
        if not ahead > 0:
            continue
        a = relative[0, 0] * x + relative[0, 1] * y + relative[0, 2] * z + relative[0, 3]
        b = relative[1, 0] * x + relative[1, 1] * y + relative[1, 2] * z + relative[1, 3]
        u = fx * a / ahead + cx + 0.5
        v = fy * b / ahead + cy + 0.5
        if u >= 0 and u < width and v >= 0 and v < height:
            to[n] = int(v) * width + int(u)
            far[n] = ahead
            sure[n] = confidence[i]
            n += 1
    return n
