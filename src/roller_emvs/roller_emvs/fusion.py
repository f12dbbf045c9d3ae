"""Depth maps of several reference views in one: warp, then average (paper, eq. fusion)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose

from .depth_map import back_project
from .rays import F32


@dataclass(frozen=True)
class ViewDepth:
    """Depth from one reference view.

    Attributes
    ----------
    depth, confidence, variance : ndarray of float32, shape (height, width)
        Metres (NaN = none), 0–1, m².
    pose : ndarray of float64, shape (4, 4)
        Camera in base.
    weight : float
        Weight in the fusion.
    """

    depth: F32
    confidence: F32
    variance: F32
    pose: F64
    weight: float


def warp_view(view: ViewDepth, target: F64, camera: Camera) -> tuple[F32, F32, F32]:
    """Depth of one view as seen from another (paper, eqs. back-projection to re-projection).

    A point goes to the nearest pixel; where two meet the nearer one hides the other.

    Parameters
    ----------
    view : ViewDepth
        Depth, confidence and variance with their pose.
    target : ndarray of float64, shape (4, 4)
        Camera in base to warp into.
    camera : Camera
        Intrinsics.

    Returns
    -------
    depth, confidence, variance : ndarray of float32, shape (height, width)
        NaN where nothing arrives.
    """
    shape = view.depth.shape
    out = [np.full(shape, np.nan, np.float32) for _ in range(3)]
    if np.array_equal(view.pose, target):
        return view.depth, view.confidence, view.variance
    points, pixels = back_project(view.depth, camera)
    relative = inverse_pose(target) @ view.pose
    points = points @ relative[:3, :3].T + relative[:3, 3]
    _splat(
        points,
        view.confidence.reshape(-1)[pixels],
        view.variance.reshape(-1)[pixels],
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        *out,
    )
    return out[0], out[1], out[2]


def fuse_views(
    views: Sequence[ViewDepth], target: F64, camera: Camera, rule: str
) -> tuple[F32, F32]:
    """Weighted mean of all views in the target view.

    Where a view has no depth the others' weights are renormalised to one.

    Parameters
    ----------
    views : sequence of ViewDepth
        At least one.
    target : ndarray of float64, shape (4, 4)
        Camera in base.
    camera : Camera
        Intrinsics.
    rule : str
        `fixed` or `inverse_variance` (each weight divided by the pixel's variance).

    Returns
    -------
    depth, confidence : ndarray of float32, shape (height, width)
        NaN where no view has a depth.
    """
    sums = np.zeros((3, camera.height, camera.width), np.float32)
    for view in views:
        _add(*warp_view(view, target, camera), view.weight, rule == "inverse_variance", sums)
    depth, confidence = (np.empty(sums.shape[1:], np.float32) for _ in range(2))
    _divide(sums, depth, confidence)
    return depth, confidence


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(sums, depth, confidence):  # type: ignore[no-untyped-def]
    """Weighted means; NaN where the weight is zero."""
    height, width = depth.shape
    for y in range(height):
        for x in range(width):
            depth[y, x] = sums[1, y, x] / sums[0, y, x]
            confidence[y, x] = sums[2, y, x] / sums[0, y, x]


@njit(cache=True, nogil=True)
def _add(depth, confidence, variance, weight, by_variance, sums):  # type: ignore[no-untyped-def]
    """Add a view's weights, weighted depths and weighted confidences."""
    height, width = depth.shape
    for y in range(height):
        for x in range(width):
            z = depth[y, x]
            if np.isnan(z):
                continue
            w = weight / variance[y, x] if by_variance else weight
            sums[0, y, x] += w
            sums[1, y, x] += w * z
            sums[2, y, x] += w * confidence[y, x]


@njit(cache=True, nogil=True)
def _splat(points, confidence, variance, fx, fy, cx, cy, out_depth, out_confidence, out_variance):  # type: ignore[no-untyped-def]
    height, width = out_depth.shape
    for i in range(len(points)):
        z = points[i, 2]
        if not z > 0:
            continue
        u = fx * points[i, 0] / z + cx + 0.5
        v = fy * points[i, 1] / z + cy + 0.5
        if u >= 0 and u < width and v >= 0 and v < height:
            x = int(u)
            y = int(v)
            if not out_depth[y, x] <= z:
                out_depth[y, x] = z
                out_confidence[y, x] = confidence[i]
                out_variance[y, x] = variance[i]
