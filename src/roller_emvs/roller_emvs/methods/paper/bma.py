"""The paper's reconstruction: one volume a reference view, fused by fixed weights.

Methods `emvs` (middle view), `left_right` (start and end) and `bma` (start, middle, end). With
`plane_rule: fixed` each view is voted for itself on all planes, as the paper has it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.rays import F32, Packets, parallax_px, rays_in_view
from roller_emvs.stopwatch import Stopwatch
from roller_emvs.threads import share

from .fusion import ViewDepth, warp_view, weighted_mean
from .median import median_of
from .paper_settings import PaperSettings
from .shifted import shifted_planes
from .threshold import KERNEL_PX, Mask, adaptive_threshold
from .votes import U16, sweep_maximum, sweep_views


def window_depth(
    packets: Packets,
    camera: Camera,
    poses: F64,
    target: F64,
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
    settings : DepthSettings
        Depth range, threads and `paper`.
    watch : Stopwatch
        Takes the time by stage.

    Returns
    -------
    depth, confidence : ndarray of float32, shape (height, width)
        Metres and 0–1; NaN where no view has a depth.
    """
    s = settings
    with watch("votes"):
        # What has fewer votes stands out of nothing.
        least = s.paper.threshold_c / 255 * s.paper.full_scale_votes
        voted = view_votes(packets, camera, poses, target, s, least)
    bounds_m = (s.depth_min_m, s.depth_max_m)
    warped: list[ViewDepth | None] = [None] * len(poses)
    weights = [weight for _, weight in s.views()]
    usable = usable_planes(voted.planes, bounds_m)

    def look(k: int) -> None:
        view = view_depth(voted, k, usable, bounds_m, weights[k], s.paper)
        warped[k] = warp_view(view, target, camera)

    with watch("detection"):
        share(s.threads, len(poses), look)
    with watch("fusion"):
        return weighted_mean([w for w in warped if w is not None], camera)


@dataclass(frozen=True)
class ViewVotes:
    """Maxima along the rays of each reference view."""

    #: Most votes along each pixel's ray and their plane. Shape (views, height, width).
    votes: F32
    index: U16
    #: Depths, metres. Shape (n,).
    planes: F64
    #: Where the views are, camera in base. Shape (views, 4, 4).
    poses: F64


def view_votes(
    packets: Packets,
    camera: Camera,
    poses: F64,
    target: F64,
    s: DepthSettings,
    least_votes: float = 0.0,
) -> ViewVotes:
    """Votes of a window in its reference views; arguments as for `window_depth`.

    Pixels around which none has more than `least_votes` may hold none.
    """
    bounds_m = (s.depth_min_m, s.depth_max_m)
    shifted = shifted_planes(camera, inverse_pose(target) @ poses, bounds_m, s.paper)
    if shifted is not None:
        rays = rays_in_view(packets, camera, target @ shifted.middle)
        least = least_votes, KERNEL_PX // 2
        views = sweep_views(rays, camera, shifted.planes, shifted.half_shifts, s.threads, least)
        if views is not None:
            return ViewVotes(*views, shifted.planes, target @ shifted.views)
    planes = choose_planes(packets, camera, target, bounds_m, s.paper)
    found = [
        sweep_maximum(rays_in_view(packets, camera, pose), camera, planes, s.threads)
        for pose in poses
    ]
    votes, index = (np.stack(images) for images in zip(*found, strict=True))
    return ViewVotes(votes, index, planes, poses)


def choose_planes(
    packets: Packets, camera: Camera, view: F64, bounds_m: tuple[float, float], s: PaperSettings
) -> F64:
    """Depths of the planes, metres: a fixed number, or as many as parallax tells apart."""
    near, far = bounds_m
    if s.plane_rule == "fixed":
        return np.linspace(near, far, s.planes)
    parallax = parallax_px(packets, camera, view, near, far)
    count = int(np.clip(np.ceil(parallax) + 1, 3, s.planes - 2))
    # One plane beyond either end, so that a peak on the first or last plane is a peak.
    step = (1.0 / near - 1.0 / far) / (count - 1)
    return np.asarray(1.0 / (1.0 / near + step * (1.0 - np.arange(count + 2))), np.float64)


def view_depth(
    voted: ViewVotes,
    k: int,
    usable: Mask,
    bounds_m: tuple[float, float],
    weight: float,
    s: PaperSettings,
) -> ViewDepth:
    """Depth from the maxima of reference view `k`: threshold and median.

    Parameters
    ----------
    voted : ViewVotes
        Of all views; the planes may reach beyond the bounds.
    k : int
        The view.
    usable : ndarray of bool, shape (n,)
        See `usable_planes`.
    bounds_m : tuple of float
        Nearest and farthest depth; what lies beyond is refused, metres.
    weight : float
        Weight in the fusion.
    s : PaperSettings
        Threshold and median.
    """
    votes, index, planes = voted.votes[k], voted.index[k], voted.planes
    mask = adaptive_threshold(votes, s.threshold_c, KERNEL_PX, s.full_scale_votes)
    at = np.flatnonzero(mask)
    at = at[usable[index.reshape(-1)[at]]]
    level = median_of(index, at, s.median_px, len(planes))
    found = np.interp(level, np.arange(len(planes)), planes)
    inside = (found >= bounds_m[0]) & (found <= bounds_m[1])
    at, found = at[inside], found[inside]
    scale = s.full_scale_votes or float(votes.max()) or 1.0
    confidence = np.clip(votes.reshape(-1)[at] / np.float32(scale), 0, 1)
    return ViewDepth(at, found.astype(np.float32), confidence, voted.poses[k], weight)


def usable_planes(planes: F64, bounds_m: tuple[float, float]) -> Mask:
    """Planes on which a peak is one: within the bounds, and not at an end."""
    # What peaks on an end plane may lie beyond it.
    steps = np.gradient(planes)
    usable = (planes > bounds_m[0] - 0.5 * steps) & (planes < bounds_m[1] + 0.5 * steps)
    usable[[0, -1]] = False
    return np.asarray(usable)
