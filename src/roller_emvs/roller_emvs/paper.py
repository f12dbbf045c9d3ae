"""The paper's reconstruction: one volume a reference view, fused by fixed weights.

Methods `emvs` (middle view), `left_right` (start and end) and `bma` (start, middle, end). This is
the reference that faster methods are measured against: all planes, exact packets and poses.
"""

from __future__ import annotations

import numpy as np

from roller_core.camera import Camera
from roller_core.transforms import F64

from .detection import adaptive_threshold, masked_median
from .fusion import ViewDepth, fuse_views
from .rays import F32, Packets, depth_planes, rays_in_view
from .settings import DepthSettings
from .stopwatch import Stopwatch
from .votes import sweep_maximum


def view_depth(
    packets: Packets,
    camera: Camera,
    view: F64,
    weight: float,
    settings: DepthSettings,
    watch: Stopwatch,
) -> ViewDepth:
    """Depth from one reference view: votes, maximum, threshold, median.

    Parameters
    ----------
    packets : Packets
        Events of the window.
    camera : Camera
        Intrinsics.
    view : ndarray of float64, shape (4, 4)
        Reference camera in base.
    weight : float
        Weight in the fusion.
    settings : DepthSettings
        Planes, threshold and median.
    watch : Stopwatch
        Takes the time by stage.
    """
    s = settings
    planes = depth_planes(s.depth_min_m, s.depth_max_m, s.planes, s.plane_spacing)
    with watch("votes"):
        rays = rays_in_view(packets, camera, view)
        votes, index = sweep_maximum(rays, camera, planes, s.threads)
    with watch("threshold"):
        mask = adaptive_threshold(votes, s.threshold_c, s.threshold_kernel_px, s.full_scale_votes)
    with watch("median"):
        median, spread = masked_median(index, mask, s.median_px, s.planes)
        depth, variance = _to_metres(median, spread, planes)
        scale = s.full_scale_votes or float(votes.max()) or 1.0
        confidence = np.where(mask, np.clip(votes / scale, 0, 1), np.nan).astype(np.float32)
    return ViewDepth(depth, confidence, variance, view, weight)


def fuse(
    views: list[ViewDepth], target: F64, camera: Camera, settings: DepthSettings, watch: Stopwatch
) -> tuple[F32, F32]:
    """Depth and confidence of all views in the target view."""
    with watch("fusion"):
        return fuse_views(views, target, camera, settings.weight_rule)


def _to_metres(median: F32, spread: F32, planes: F64) -> tuple[F32, F32]:
    """Depth in metres and its variance in m² from plane numbers."""
    seen = np.isfinite(median)
    depth = np.full(median.shape, np.nan, np.float32)
    variance = np.full(median.shape, np.nan, np.float32)
    number = median[seen].astype(np.int64)
    depth[seen] = planes[number]
    # 1.349 standard deviations lie between the quartiles of a normal distribution; half a
    # plane is the least that can be told.
    step = np.gradient(planes)[number]
    variance[seen] = (step * np.maximum(spread[seen] / 1.349, 0.5)) ** 2
    return depth, variance
