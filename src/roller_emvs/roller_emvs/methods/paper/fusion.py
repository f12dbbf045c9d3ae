"""Depth maps of several reference views in one: warp, then average (paper, eq. fusion)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose
from roller_emvs.rays import F32, I64
from roller_emvs.threads import share

#: Pixels that are looked at together: most hold nothing in any view.
_CHUNK = 32


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


def warp_view(view: ViewDepth, target: F64, camera: Camera) -> tuple[F32, F32]:
    """Depth of one view as seen from another (paper, eqs. back-projection to re-projection).

    A point goes to the nearest pixel; where two meet the nearer one hides the other.

    Parameters
    ----------
    view : ViewDepth
        Depth and confidence with their pose.
    target : ndarray of float64, shape (4, 4)
        Camera in base to warp into.
    camera : Camera
        Intrinsics.

    Returns
    -------
    depth, confidence : ndarray of float32, shape (height, width)
        Depth is NaN where nothing arrives; confidence means nothing there.
    """
    shape = (camera.height, camera.width)
    depth, confidence = (np.empty(shape, np.float32) for _ in range(2))
    depth.fill(np.nan)
    if np.array_equal(view.pose, target):
        depth.reshape(-1)[view.pixels] = view.depth
        confidence.reshape(-1)[view.pixels] = view.confidence
        return depth, confidence
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    relative = inverse_pose(target) @ view.pose
    _splat(view.pixels, view.depth, view.confidence, intrinsics, relative, depth, confidence)
    return depth, confidence


def fuse_views(views: Sequence[ViewDepth], target: F64, camera: Camera) -> tuple[F32, F32]:
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

    Returns
    -------
    depth, confidence : ndarray of float32, shape (height, width)
        NaN where no view has a depth.
    """
    warped = [warp_view(view, target, camera) for view in views]
    return weighted_mean(warped, [view.weight for view in views])


def weighted_mean(
    warped: Sequence[tuple[F32, F32]], weights: Sequence[float], threads: int = 1
) -> tuple[F32, F32]:
    """Weighted mean of views that were warped into one; see `fuse_views`.

    Parameters
    ----------
    warped : sequence of tuple of ndarray of float32, shape (height, width)
        Depth and confidence of each view, at least one; as of `warp_view`.
    weights : sequence of float
        Weight of each.
    threads : int
        Threads that share the rows.
    """
    shape = warped[0][0].shape
    depth, confidence = (np.empty(shape, np.float32) for _ in range(2))
    views = tuple(zip(*warped, strict=True))
    share_of = np.array(weights, np.float64)

    def run(k: int) -> None:
        rows = (shape[0] * k // threads, shape[0] * (k + 1) // threads)
        _mean(*views, share_of, rows, depth, confidence)

    share(threads, threads, run)
    return depth, confidence


@njit(cache=True, nogil=True, error_model="numpy")
def _mean(depths, confidences, weights, rows, depth, confidence):  # type: ignore[no-untyped-def]
    """Weighted means of some rows; NaN where the weight is zero."""
    width = depth.shape[1]
    nothing = np.float32(np.nan)
    for y in range(rows[0], rows[1]):
        for begin in range(0, width, _CHUNK):
            end = min(begin + _CHUNK, width)
            some = False
            for k in range(len(depths)):
                some |= _any(depths[k].reshape(-1), y * width + begin, end - begin)
            if some:
                _mean_at(depths, confidences, weights, y, begin, end, depth, confidence)
            else:
                depth[y, begin:end] = nothing
                confidence[y, begin:end] = nothing


@njit(cache=True, nogil=True)
def _any(values, start, count):  # type: ignore[no-untyped-def]
    """Whether some of the values from a place on are known."""
    at, some = np.uint64(start), False
    for i in range(np.uint64(count)):
        some |= values[at + i] == values[at + i]
    return some


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_at(depths, confidences, weights, y, begin, end, depth, confidence):  # type: ignore[no-untyped-def]
    """`_mean` of some columns of a row."""
    real = np.float32
    for x in range(begin, end):
        total = real(0)
        far = real(0)
        sure = real(0)
        for k in range(len(depths)):
            z = depths[k][y, x]
            if np.isnan(z):
                continue
            w = weights[k]
            total = real(total + w)
            far = real(far + w * z)
            sure = real(sure + w * confidences[k][y, x])
        depth[y, x] = far / total
        confidence[y, x] = sure / total


@njit(cache=True, nogil=True)
def _splat(  # type: ignore[no-untyped-def]
    pixels, depth, confidence, intrinsics, relative, out_depth, out_confidence
):
    """Points of a view at the pixels where another sees them; `relative` is the view in it."""
    fx, fy, cx, cy = intrinsics
    height, width = out_depth.shape
    for i in range(len(pixels)):
        z = np.float64(depth[i])
        x = (pixels[i] % width - cx) / fx * z
        y = (pixels[i] // width - cy) / fy * z
        far = relative[2, 0] * x + relative[2, 1] * y + relative[2, 2] * z + relative[2, 3]
        if not far > 0:
            continue
        a = relative[0, 0] * x + relative[0, 1] * y + relative[0, 2] * z + relative[0, 3]
        b = relative[1, 0] * x + relative[1, 1] * y + relative[1, 2] * z + relative[1, 3]
        u = fx * a / far + cx + 0.5
        v = fy * b / far + cy + 0.5
        if u >= 0 and u < width and v >= 0 and v < height:
            column = int(u)
            row = int(v)
            if not out_depth[row, column] <= far:
                out_depth[row, column] = far
                out_confidence[row, column] = confidence[i]
