"""The paper's reconstruction: one volume a reference view, fused by fixed weights.

Methods `emvs` (middle view), `left_right` (start and end) and `bma` (start, middle, end). With
`plane_rule: fixed`, `fast_path: false` this is the reference that faster settings are measured
against: all planes, exact packets and poses.
"""

from __future__ import annotations

import numpy as np

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose

from .detection import adaptive_threshold, masked_median
from .fusion import ViewDepth, fuse_views
from .rays import F32, Packets, depth_planes, parallax_px, rays_in_view
from .settings import DepthSettings
from .stopwatch import Stopwatch
from .threads import share
from .votes import I64, U16, sweep_maximum, sweep_views


def window_depth(
    packets: Packets,
    camera: Camera,
    poses: F64,
    target: F64,
    bounds_m: tuple[float, float],
    settings: DepthSettings,
    watch: Stopwatch,
) -> tuple[F32, F32]:
    """Depth and confidence of a window in the target view, fused from the reference views.

    Parameters
    ----------
    packets : Packets
        Events of the window.
    camera : Camera
        Intrinsics.
    poses : ndarray of float64, shape (views, 4, 4)
        Reference cameras in base, in the order of `settings.views()`.
    target : ndarray of float64, shape (4, 4)
        Camera in base to fuse in.
    bounds_m : tuple of float
        Nearest and farthest depth, metres.
    settings : DepthSettings
        Planes, threshold, median and weights.
    watch : Stopwatch
        Takes the time by stage.

    Returns
    -------
    depth, confidence : ndarray of float32, shape (height, width)
        Metres and 0–1; NaN where no view has a depth.
    """
    s = settings
    relative = inverse_pose(target) @ poses
    shifted = shifted_planes(camera, relative, bounds_m, s) if s.fast_path else None
    with watch("votes"):
        if shifted is not None:
            planes, half_shifts = shifted
            rays = rays_in_view(packets, camera, target, s.precision)
            votes, index = sweep_views(rays, camera, planes, half_shifts, s.threads, s.tiles)
        else:
            planes = choose_planes(packets, camera, target, bounds_m, s)
            found = [
                sweep_maximum(
                    rays_in_view(packets, camera, pose, s.precision),
                    camera, planes, s.threads, s.tiles,
                )
                for pose in poses
            ]  # fmt: skip
            votes, index = (np.stack(images) for images in zip(*found, strict=True))
    views: list[ViewDepth | None] = [None] * len(poses)
    weights = [weight for _, weight in s.views()]

    def look(k: int) -> None:
        views[k] = view_depth(votes[k], index[k], planes, poses[k], weights[k], s)

    with watch("detection"):
        share(s.threads, len(poses), look)
    with watch("fusion"):
        return fuse_views([v for v in views if v is not None], target, camera, s.weight_rule)


def choose_planes(
    packets: Packets, camera: Camera, view: F64, bounds_m: tuple[float, float], s: DepthSettings
) -> F64:
    """Depths of the planes, metres: a fixed number, or as many as parallax tells apart."""
    near, far = bounds_m
    if s.plane_rule == "fixed":
        return depth_planes(near, far, s.planes, s.plane_spacing)
    parallax = parallax_px(packets, camera, view, near, far)
    count = int(np.clip(np.ceil(parallax * s.planes_per_px) + 1, 5, s.planes))
    return depth_planes(near, far, count, "inverse_depth")


def shifted_planes(
    camera: Camera, relative: F64, bounds_m: tuple[float, float], s: DepthSettings
) -> tuple[F64, I64] | None:
    """Planes on which the reference views differ by whole or half pixels, if there are.

    Two views B apart along u see a plane of inverse depth w shifted by F·B·w; planes F·B apart
    in steps of half a pixel are one pixel of the window's parallax apart.

    Parameters
    ----------
    camera : Camera
        Intrinsics.
    relative : ndarray of float64, shape (views, 4, 4)
        Reference cameras in the camera that is voted in.
    bounds_m : tuple of float
        Nearest and farthest depth, metres.
    s : DepthSettings
        `plane_rule`, `planes_per_px` and `fast_path_max_px`.

    Returns
    -------
    planes : ndarray of float64, shape (n,)
        Depths, metres, near to far.
    half_shifts : ndarray of int64, shape (views, n)
        In halves of a pixel.
    """
    if s.plane_rule == "fixed" or s.planes_per_px > 1.0 or len(relative) < 2:
        return None
    x = relative[:, 0, 3]
    baseline = float(np.abs(x).max())
    low, high = 1.0 / bounds_m[1], 1.0 / bounds_m[0]
    if camera.fx * baseline * (high - low) < 2.0:
        return None
    # Halves of a pixel by which the farthest view is shifted, from far to near.
    first, last = np.ceil(2 * camera.fx * baseline * low), 2 * camera.fx * baseline * high
    planes = 2 * camera.fx * baseline / np.arange(first, last + 1e-9)[::-1]
    if not 3 <= len(planes) <= s.planes:
        return None
    exact = 2 * camera.fx * x[:, None] / planes
    half_shifts = np.rint(exact).astype(np.int64)
    error = float(np.abs(exact - half_shifts).max()) / 2
    error += max(shift_error_px(camera, r, bounds_m) for r in relative)
    return (planes, half_shifts) if error <= s.fast_path_max_px else None


def shift_error_px(camera: Camera, relative: F64, bounds_m: tuple[float, float]) -> float:
    """Error of taking a view for one shifted along the image's rows, anywhere in the volume.

    Parameters
    ----------
    camera : Camera
        Intrinsics.
    relative : ndarray of float64, shape (4, 4)
        The view's camera in the camera that is voted in.
    bounds_m : tuple of float
        Nearest and farthest depth, metres.

    Returns
    -------
    float
        Most distance, at the volume's corners, between where a point is seen and where the shift
        puts it, and of the parallax by which its plane differs, px.
    """
    u, v = np.meshgrid([0.0, camera.width - 1.0], [0.0, camera.height - 1.0])
    corners = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, u * 0 + 1], -1)
    points = np.concatenate([corners.reshape(-1, 3) * z for z in bounds_m])
    seen = (points - relative[:3, 3]) @ relative[:3, :3]
    if (seen[:, 2] <= 0).any():
        return float("inf")
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    place = seen[:, :2] / seen[:, 2:] * focal + centre
    told = points[:, :2] / points[:, 2:] * focal + centre
    told[:, 0] -= camera.fx * relative[0, 3] / points[:, 2]
    baseline = float(np.linalg.norm(relative[:3, 3]))
    plane = np.abs(1.0 / seen[:, 2] - 1.0 / points[:, 2]) * focal.max() * baseline
    return float(max(np.linalg.norm(place - told, axis=1).max(), plane.max()))


def view_depth(
    votes: F32, index: U16, planes: F64, view: F64, weight: float, settings: DepthSettings
) -> ViewDepth:
    """Depth from one reference view's maxima: threshold and median.

    Parameters
    ----------
    votes, index : ndarray, shape (height, width)
        Maximum along each ray and its plane.
    planes : ndarray of float64, shape (n,)
        Depths, metres.
    view : ndarray of float64, shape (4, 4)
        Reference camera in base.
    weight : float
        Weight in the fusion.
    settings : DepthSettings
        Threshold and median.
    """
    s = settings
    mask = adaptive_threshold(votes, s.threshold_c, s.threshold_kernel_px, s.full_scale_votes)
    # The top of a ray that peaks on an end plane was not seen: it may lie beyond the range.
    mask &= (index > 0) & (index < len(planes) - 1)
    median, spread = masked_median(
        index, mask, s.median_px, len(planes), s.weight_rule == "inverse_variance"
    )
    scale = s.full_scale_votes or float(votes.max()) or 1.0
    depth, variance = _to_metres(median, spread, mask, planes)
    confidence = np.where(mask, np.clip(votes / np.float32(scale), 0, 1), np.float32(np.nan))
    return ViewDepth(depth, confidence, variance, view, weight)


def _to_metres(median: F32, spread: F32, mask: np.ndarray, planes: F64) -> tuple[F32, F32]:
    """Depth in metres and its variance in m² from plane numbers."""
    depth = np.full(median.shape, np.nan, np.float32)
    variance = np.full(median.shape, np.nan, np.float32)
    number = np.arange(len(planes))
    at = median[mask].astype(np.float64)
    depth[mask] = np.interp(at, number, planes)
    # 1.349 standard deviations lie between the quartiles of a normal distribution; half a
    # plane is the least that can be told.
    step = np.interp(at, number, np.gradient(planes))
    variance[mask] = (step * np.maximum(spread[mask] / 1.349, 0.5)) ** 2
    return depth, variance
