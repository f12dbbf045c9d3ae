"""Refining a depth map's pose against the cloud so far, taken only when it can be trusted.

Point-to-plane ICP (Chen and Medioni 1992). The robot's pose is the start and usually better than
what relief can add (the paper found 0.0002 mm), so a correction must be well conditioned, as small
as a robot's error, and lower the residual of points that did not help to find it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64, pose_matrix, rotation_vector_to_quaternion

from . import _voxel_kernels as _kernels

#: Points further apart than this don't correspond, m.
MAX_DISTANCE_M = 3e-4
_MIN_PAIRS = 100
#: Points of a depth map that are used at most, and pairs of them by which it is seen beforehand
#: whether the geometry fixes the pose.
_MOST_POINTS, _MOST_LOOKED_AT = 4000, 500
#: A tree that gives the nearest point, not nearly the nearest (FLANN_INDEX_KDTREE_SINGLE).
_EXACT_TREE, _SEARCH = {"algorithm": 4, "leaf_max_size": 32}, {"checks": -1}
#: Points that a normal is taken from, at most, and their distance, m.
_NORMAL_POINTS, _NORMAL_M = 30, 4 * MAX_DISTANCE_M
#: Steps at most, and the change of the share of points with a pair, and of their distance, m, that
#: ends them.
_STEPS, _SETTLED = 15, (1e-6, 1e-6)
#: Smallest to largest eigenvalue of the normal equations below which the geometry doesn't fix the
#: pose, and the share by which the residual must fall.
_MIN_CONDITIONING, _MIN_GAIN = 0.01, 0.05
_LOOSE = "the geometry does not fix the pose"
#: A correction that moves a point further than this is refused, m.
_MOST_CORRECTION_M = 5e-5
#: Nor does one come to less that has moved a point so far on its way, m: it is sought no further.
_GIVEN_UP_M = 2 * _MOST_CORRECTION_M


@dataclass(frozen=True)
class Refinement:
    """What ICP found and whether it was taken."""

    #: To apply on the left of the pose; the identity if it was refused. Shape (4, 4).
    correction: F64
    #: Whether it was taken.
    accepted: bool
    #: Why it was refused; empty if it was taken.
    reason: str


class _Target:
    """The cloud to align with; normals are worked out where points come near."""

    def __init__(self, points: F64) -> None:
        self._points = points
        # scipy's tree answers as exactly, but takes as long to load as a scan to stitch.
        self._features = points.astype(np.float32)
        self._tree: Any = cv2.flann.Index(self._features, _EXACT_TREE)
        self._normals = np.full_like(points, np.nan)

    def pairs(self, points: F64) -> _Pairs:
        """The nearest of the cloud for those points that have one near enough."""
        nearest, squares = self._nearest(points, 1)
        own = np.flatnonzero(squares[:, 0] <= MAX_DISTANCE_M**2)
        rms = float(np.sqrt(squares[own].mean(dtype=np.float64))) if len(own) else 0.0
        return _Pairs(own, nearest[own, 0], len(own) / len(points), rms)

    def planes(self, which: npt.NDArray[np.intp]) -> tuple[F64, F64]:
        """Points of the cloud and their normals."""
        new = np.unique(which[np.isnan(self._normals[which, 0])])
        if len(new):
            near, squares = self._nearest(self._points[new], _NORMAL_POINTS)
            near[squares > _NORMAL_M**2] = len(self._points)
            moments, count = np.empty((len(new), 3, 3)), np.empty(len(new), np.int64)
            _kernels._spread(self._points, new, near, moments, count)
            normals = np.linalg.eigh(moments)[1][:, :, 0]
            normals[count < 3] = 0.0, 0.0, 1.0
            self._normals[new] = normals
        return self._points[which], self._normals[which]

    def _nearest(
        self, points: F64, count: int
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
        """Numbers of the cloud's points that lie nearest, and the squares of their distances."""
        near, squares = self._tree.knnSearch(points.astype(np.float32), count, params=_SEARCH)
        return near.astype(np.intp), squares


@dataclass(frozen=True)
class _Pairs:
    """Numbers of points and of the cloud's nearest; share that has one, and their distance."""

    own: npt.NDArray[np.intp]
    nearest: npt.NDArray[np.intp]
    fitness: float
    rms_m: float


def refine(points: F64, target: F64) -> Refinement:
    """Align points with a cloud that they overlap.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 3)
        New points in base, metres, as the robot's pose puts them.
    target : ndarray of float64, shape (m, 3)
        The cloud so far near them, metres.
    """
    if min(len(points), len(target)) < _MIN_PAIRS:
        return _refused("too few points overlap")
    # Near the origin arithmetic keeps nanometres, wherever the robot's base is.
    origin = points.mean(axis=0)
    step = max(len(points) // _MOST_POINTS, 1)
    chosen = points[::step] - origin
    # Half of the points find the correction, the other half judge it.
    finding, judging, cloud = chosen[::2], chosen[1::2], _Target(target - origin)
    before = cloud.pairs(judging)
    if len(before.own) < _MIN_PAIRS:
        return _refused("too few points overlap")
    # As a rule it doesn't: relief that fixes all of a pose is rare, and normals cost most.
    look = slice(None, None, -(-len(before.own) // _MOST_LOOKED_AT))
    normals = cloud.planes(before.nearest[look])[1]
    if _conditioning(judging[before.own[look]], normals) < _MIN_CONDITIONING:
        return _refused(_LOOSE)
    moved, pairs = _icp(finding, cloud)
    if len(pairs.own) < _MIN_PAIRS or not np.isfinite(moved).all():
        return _refused("ICP did not converge")
    # What counts is how far any point moves: a small turn far out is no small correction.
    shift = _shift_m(moved, chosen)
    if shift > _MOST_CORRECTION_M:
        return _refused(f"a correction of {shift * 1e6:.0f} µm is implausible")
    conditioning = _conditioning(finding[pairs.own], cloud.planes(pairs.nearest)[1])
    if conditioning < _MIN_CONDITIONING:
        return _refused(_LOOSE)
    after = cloud.pairs(_move(moved, judging))
    if after.rms_m > before.rms_m * (1 - _MIN_GAIN) or after.fitness < before.fitness * 0.98:
        return _refused("no better than the robot's pose")
    shift_back, shift_out = np.eye(4), np.eye(4)
    shift_back[:3, 3], shift_out[:3, 3] = -origin, origin
    return Refinement(shift_out @ moved @ shift_back, True, "")


def _icp(points: F64, cloud: _Target) -> tuple[F64, _Pairs]:
    """The pose that lays points onto the planes of the cloud, and what corresponds there."""
    pose, pairs = np.eye(4), cloud.pairs(points)
    for _ in range(_STEPS):
        if len(pairs.own) < _MIN_PAIRS:
            break
        here = _move(pose, points[pairs.own])
        there, normals = cloud.planes(pairs.nearest)
        rows = np.hstack([np.cross(here, normals), normals])
        away = ((there - here) * normals).sum(axis=1)
        # A motion that nothing hinders is none.
        turn_and_shift = np.linalg.lstsq(rows, away, rcond=1e-9)[0]
        turn = rotation_vector_to_quaternion(turn_and_shift[:3])
        pose = pose_matrix(turn_and_shift[3:], turn) @ pose
        if _shift_m(pose, points) > _GIVEN_UP_M:
            break
        last, pairs = pairs, cloud.pairs(_move(pose, points))
        change = abs(pairs.fitness - last.fitness), abs(pairs.rms_m - last.rms_m)
        if change[0] < _SETTLED[0] and change[1] < _SETTLED[1]:
            break
    return pose, pairs


def _move(pose: F64, points: F64) -> F64:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _shift_m(pose: F64, points: F64) -> float:
    """How far a pose moves any of some points, metres."""
    return float(np.linalg.norm(_move(pose, points) - points, axis=1).max())


def _refused(reason: str) -> Refinement:
    return Refinement(np.eye(4), False, reason)


def _conditioning(points: F64, normals: F64) -> float:
    """Smallest to largest eigenvalue of point-to-plane ICP's normal equations.

    Lengths are scaled by the points' spread, so rotations and translations compare.
    """
    centred = points - points.mean(axis=0)
    size = np.sqrt((centred**2).sum(axis=1).mean()) or 1.0
    rows = np.hstack([np.cross(centred / size, normals), normals])
    values = np.linalg.eigvalsh(rows.T @ rows)
    return float(max(values[0], 0.0) / values[-1]) if values[-1] > 0 else 0.0
