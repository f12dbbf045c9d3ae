"""Planes on which reference views see the same votes, moved by halves of a pixel.

One round of votes then serves all views; see `votes.sweep_views`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose

from .paper_settings import PaperSettings
from .votes import I64

#: How far along u a reference view may be put elsewhere, as a share of half the travel.
_MOST_ALONG = 0.2
#: How far in every other respect, px; else every view is voted for itself.
_MOST_ACROSS_PX = 1.0


@dataclass(frozen=True)
class ShiftedPlanes:
    """Planes on which the reference views differ by whole or half pixels."""

    #: Depths, metres, near to far. Shape (n,).
    planes: F64
    #: From the view that is voted in to each view, in halves of a pixel. Shape (views, n).
    half_shifts: I64
    #: The view that is voted in, half-way between the ends, in the target view. Shape (4, 4).
    middle: F64
    #: Where the reference views are put, in the target view. Shape (views, 4, 4).
    views: F64


def shifted_planes(
    camera: Camera, relative: F64, bounds_m: tuple[float, float], s: PaperSettings
) -> ShiftedPlanes | None:
    """Planes on which the reference views differ by whole or half pixels, if there are.

    Two views B apart along u see a plane of inverse depth w shifted by F·B·w; planes F·B apart
    in steps of half a pixel are one pixel of the window's parallax apart. The views are put
    where the shifts are exact: at the ends and half-way between, axes parallel. A reference view
    may be anywhere, so depth stays exact; only the place it is seen from is another, by no more
    than a share of the travel along u and a pixel in every other respect.

    Parameters
    ----------
    camera : Camera
        Intrinsics.
    relative : ndarray of float64, shape (views, 4, 4)
        Reference cameras in the target view.
    bounds_m : tuple of float
        Nearest and farthest depth, metres.
    s : PaperSettings
        `plane_rule` and `planes`.
    """
    if s.plane_rule == "fixed" or len(relative) < 2:
        return None
    x = relative[:, 0, 3]
    centre, baseline = 0.5 * float(x.min() + x.max()), 0.5 * float(np.ptp(x))
    low, high = 1.0 / bounds_m[1], 1.0 / bounds_m[0]
    if camera.fx * baseline * (high - low) < 2.0:
        return None
    # Halves of a pixel by which the end views are shifted, from near to far and one beyond.
    halves = np.arange(
        int(np.floor(2 * camera.fx * baseline * low)) - 1,
        int(np.ceil(2 * camera.fx * baseline * high)) + 2,
    )[::-1]
    if not 5 <= len(halves) <= s.planes or halves[-1] <= 0:
        return None
    place = np.rint((x - centre) / baseline).astype(np.int64)
    along = np.abs(x - centre - place * baseline)
    if along.max() > _MOST_ALONG * baseline:
        return None
    put = np.tile(np.eye(4), (len(x), 1, 1))
    put[:, 0, 3] = x
    if view_distance_px(camera, inverse_pose(put) @ relative, bounds_m) > _MOST_ACROSS_PX:
        return None
    views = np.tile(np.eye(4), (len(x) + 1, 1, 1))
    views[:, 0, 3] = centre + np.append(place, 0) * baseline
    planes = 2 * camera.fx * baseline / halves
    return ShiftedPlanes(planes, place[:, None] * halves[None, :], views[-1], views[:-1])


def view_distance_px(camera: Camera, relative: F64, bounds_m: tuple[float, float]) -> float:
    """How far apart two views see a point of the volume, at most.

    Parameters
    ----------
    camera : Camera
        Intrinsics.
    relative : ndarray of float64, shape (n, 4, 4)
        One camera in the other, of any number of pairs.
    bounds_m : tuple of float
        Nearest and farthest depth, metres.

    Returns
    -------
    float
        Most distance at the volume's corners, px.
    """
    u, v = np.meshgrid([0.0, camera.width - 1.0], [0.0, camera.height - 1.0])
    corners = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, u * 0 + 1], -1)
    points = np.concatenate([corners.reshape(-1, 3) * z for z in bounds_m])
    seen = (points - relative[:, None, :3, 3]) @ relative[:, :3, :3]
    if (seen[..., 2] <= 0).any():
        return float("inf")
    apart = points[:, :2] / points[:, 2:] - seen[..., :2] / seen[..., 2:]
    return float(np.linalg.norm(apart * [camera.fx, camera.fy], axis=-1).max())
