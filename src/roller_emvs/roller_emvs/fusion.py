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
from .threads import share


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
    warped = [warp_view(view, target, camera) for view in views]
    return weighted_mean(warped, [view.weight for view in views], rule)


def weighted_mean(
    warped: Sequence[tuple[F32, F32, F32]], weights: Sequence[float], rule: str, threads: int = 1
) -> tuple[F32, F32]:
    """Weighted mean of views that were warped into one; see `fuse_views`.

    Parameters
    ----------
    warped : sequence of tuple of ndarray of float32, shape (height, width)
        Depth, confidence and variance of each view, at least one; as of `warp_view`.
    weights : sequence of float
        Weight of each.
    rule : str
        As of `fuse_views`.
    threads : int
        Threads that share the rows.
    """
    shape, by_variance = warped[0][0].shape, rule == "inverse_variance"
    depth, confidence = (np.empty(shape, np.float32) for _ in range(2))
    views = tuple(zip(*warped, strict=True))
    share_of = np.array(weights, np.float64)

    def run(k: int) -> None:
        rows = (shape[0] * k // threads, shape[0] * (k + 1) // threads)
        _mean(*views, share_of, by_variance, rows, depth, confidence)

    share(threads, threads, run)
    return depth, confidence


@njit(cache=True, nogil=True, error_model="numpy")
def _mean(depths, confidences, variances, weights, by_variance, rows, depth, confidence):  # type: ignore[no-untyped-def]
    """Weighted means of some rows; NaN where the weight is zero."""
    real = np.float32
    for y in range(rows[0], rows[1]):
        for x in range(depth.shape[1]):
            total = real(0)
            far = real(0)
            sure = real(0)
            for k in range(len(depths)):
                z = depths[k][y, x]
                if np.isnan(z):
                    continue
                w = weights[k] / variances[k][y, x] if by_variance else weights[k]
                total = real(total + w)
                far = real(far + w * z)
                sure = real(sure + w * confidences[k][y, x])
            depth[y, x] = far / total
            confidence[y, x] = sure / total


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
