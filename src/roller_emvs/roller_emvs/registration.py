"""Refining a depth map's pose against the cloud so far, taken only when it can be trusted.

Point-to-plane ICP (Chen and Medioni 1992; open3d). The robot's pose is the start and usually
better than what relief can add (the paper found 0.0002 mm), so a correction must be well
conditioned, as small as a robot's error, and lower the residual of points that did not help to
find it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d

from roller_core.transforms import F64

from .depth_settings import StitcherSettings

#: Points further apart than this don't correspond, m.
MAX_DISTANCE_M = 3e-4
_MIN_PAIRS = 100
#: Points of a depth map that are used at most.
_MOST_POINTS = 4000
#: Smallest to largest eigenvalue of the normal equations below which the geometry doesn't fix the
#: pose, and the share by which the residual must fall.
_MIN_CONDITIONING, _MIN_GAIN = 0.01, 0.05


@dataclass(frozen=True)
class Refinement:
    """What ICP found and whether it was taken.

    Attributes
    ----------
    correction : ndarray of float64, shape (4, 4)
        To apply on the left of the pose; the identity if it was refused.
    accepted : bool
    reason : str
        Why it was refused; empty if it was taken.
    conditioning : float
        Smallest to largest eigenvalue of the normal equations; 0 if never computed.
    residual_before_m, residual_after_m : float
        Root mean square distance of corresponding points, metres.
    """

    correction: F64
    accepted: bool
    reason: str
    conditioning: float = 0.0
    residual_before_m: float = float("nan")
    residual_after_m: float = float("nan")


def refine(points: F64, target: F64, settings: StitcherSettings) -> Refinement:
    """Align points with a cloud that they overlap.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 3)
        New points in base, metres, as the robot's pose puts them.
    target : ndarray of float64, shape (m, 3)
        The cloud so far near them, metres.
    settings : StitcherSettings
        `icp_max_correction_m`.
    """
    s = settings
    if min(len(points), len(target)) < _MIN_PAIRS:
        return _refused("too few points overlap")
    # Near the origin open3d's arithmetic keeps nanometres, wherever the robot's base is.
    origin = points.mean(axis=0)
    step = max(len(points) // _MOST_POINTS, 1)
    chosen = points[::step] - origin
    # Half of the points find the correction, the other half judge it.
    finding, judging = _cloud(chosen[::2]), _cloud(chosen[1::2])
    cloud = _cloud(target - origin)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(4 * MAX_DISTANCE_M, 30))
    reg = o3d.pipelines.registration
    before = reg.evaluate_registration(judging, cloud, MAX_DISTANCE_M)
    if len(before.correspondence_set) < _MIN_PAIRS:
        return _refused("too few points overlap")
    result = reg.registration_icp(
        finding,
        cloud,
        MAX_DISTANCE_M,
        np.eye(4),
        reg.TransformationEstimationPointToPlane(),
        reg.ICPConvergenceCriteria(max_iteration=15),
    )
    pairs = np.asarray(result.correspondence_set)
    moved = np.asarray(result.transformation)
    if len(pairs) < _MIN_PAIRS or not np.isfinite(moved).all():
        return _refused("ICP did not converge")
    conditioning = _conditioning(
        np.asarray(finding.points)[pairs[:, 0]], np.asarray(cloud.normals)[pairs[:, 1]]
    )
    after = reg.evaluate_registration(judging, cloud, MAX_DISTANCE_M, moved)
    figures = (conditioning, float(before.inlier_rmse), float(after.inlier_rmse))
    if conditioning < _MIN_CONDITIONING:
        return _refused("the geometry does not fix the pose", *figures)
    # What counts is how far any point moves: a small turn far out is no small correction.
    shift = np.linalg.norm(chosen @ moved[:3, :3].T + moved[:3, 3] - chosen, axis=1).max()
    if shift > s.icp_max_correction_m:
        return _refused(f"a correction of {shift * 1e6:.0f} µm is implausible", *figures)
    if after.inlier_rmse > before.inlier_rmse * (1 - _MIN_GAIN) or (
        after.fitness < before.fitness * 0.98
    ):
        return _refused("no better than the robot's pose", *figures)
    shift_back, shift_out = np.eye(4), np.eye(4)
    shift_back[:3, 3], shift_out[:3, 3] = -origin, origin
    return Refinement(shift_out @ moved @ shift_back, True, "", *figures)


def _refused(
    reason: str,
    conditioning: float = 0.0,
    before: float = float("nan"),
    after: float = float("nan"),
) -> Refinement:
    return Refinement(np.eye(4), False, reason, conditioning, before, after)


def _cloud(points: F64) -> o3d.geometry.PointCloud:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.ascontiguousarray(points)))


def _conditioning(points: F64, normals: F64) -> float:
    """Smallest to largest eigenvalue of point-to-plane ICP's normal equations.

    Lengths are scaled by the points' spread, so rotations and translations compare.
    """
    centred = points - points.mean(axis=0)
    size = np.sqrt((centred**2).sum(axis=1).mean()) or 1.0
    rows = np.hstack([np.cross(centred / size, normals), normals])
    values = np.linalg.eigvalsh(rows.T @ rows)
    return float(max(values[0], 0.0) / values[-1]) if values[-1] > 0 else 0.0
