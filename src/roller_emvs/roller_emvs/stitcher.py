"""From depth maps to one cloud in `base`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.pose_track import PoseValueError
from roller_core.transforms import F64

from . import _voxel_kernels as _kernels
from .depth_map import F32, DepthMap, back_project
from .depth_settings import StitcherSettings
from .patch import Patch
from .registration import MAX_DISTANCE_M, Refinement, refine
from .voxels import VoxelMap, intrinsics_of

#: Voxels under work at most; beyond it the oldest are settled early.
_MOST_VOXELS = 3_000_000
#: Voxels are this high along the view, m: the skin shows one surface, and what two depth maps say
#: of a place counts together, by what each is sure of. Beyond this turn of the view, rad, the cloud
#: goes on with voxels along the new one.
_LAYER_M, _MOST_TURN = 4e-3, 0.26
#: Neighbours within `outlier_radius_m` that a point needs to stay.
_NEIGHBOURS = 3


class Stitcher:
    """Adds depth maps to a cloud; a point is handed out once, when it is out of view.

    Memory holds what is in view and at most three million voxels, so a scan may be of any length.

    Parameters
    ----------
    settings : StitcherSettings
        Voxels, ICP and filters.
    camera : Camera
        Intrinsics of the depth maps.
    """

    def __init__(self, settings: StitcherSettings, camera: Camera) -> None:
        self.settings = settings
        self.camera = camera
        self.voxels = VoxelMap(settings.voxel_m)
        self.icp_tried = 0
        self.icp_accepted = 0
        self.last_refinement: Refinement | None = None

    def add(self, depth_map: DepthMap) -> Patch:
        """Merge a depth map.

        Returns
        -------
        Patch
            Points that this view no longer reaches; often empty.

        Raises
        ------
        PoseValueError
            If its pose is not finite; the cloud is unchanged.
        """
        if not np.all(np.isfinite(depth_map.pose)):
            raise PoseValueError(
                f"pose of the depth map at {depth_map.stamp_ns * 1e-9:.6f} s is not finite; "
                "it is left out"
            )
        before = self._turn_to(depth_map.pose)
        points, confidence, sigma = self._points(depth_map)
        if self.settings.icp and len(points) and len(self.voxels):
            margin = MAX_DISTANCE_M
            low, high = ([end(c) for c in points.T] for end in (np.min, np.max))
            target = self.voxels.near(np.array(low) - margin, np.array(high) + margin)
            found = refine(points, target)
            self.last_refinement = found
            self.icp_tried += 1
            if found.accepted:
                self.icp_accepted += 1
                points = points @ found.correction[:3, :3].T + found.correction[:3, 3]
        self.voxels.add(points, confidence, sigma)
        keep = self.voxels.in_view(self.camera, depth_map.pose)
        over = int(keep.sum()) - _MOST_VOXELS
        if over > 0:
            keep &= self.voxels.oldest(over)
        points, confidence, sigma = self.voxels.settle(keep)
        if before is not None:
            points = np.concatenate([before[0], points])
            confidence, sigma = (
                np.concatenate(both) for both in ((before[1], confidence), (before[2], sigma))
            )
        return self._patch(points, confidence, sigma)

    def finish(self) -> Patch:
        """Hand out what is left; the scan is over."""
        return self._patch(*self._all())

    def _all(self) -> tuple[F64, F32, F32]:
        return self.voxels.settle(np.zeros(len(self.voxels), bool))

    def _turn_to(self, pose: F64) -> tuple[F64, F32, F32] | None:
        """See that voxels lie along a view; the points of those that lay along another."""
        if len(self.voxels) and pose[:3, 2] @ self.voxels.axes[:, 2] > np.cos(_MOST_TURN):
            return None
        before = self._all()
        self.voxels = VoxelMap(self.settings.voxel_m, pose[:3, :3], _LAYER_M)
        return before

    def _points(self, depth_map: DepthMap) -> tuple[F64, F32, F32]:
        depth, radius_m = depth_map.depth, self.settings.outlier_radius_m
        if radius_m:
            points, pixels = back_project(depth, self.camera)
            depth = depth.copy()
            if len(points):
                alone = ~radius_filter(points, radius_m, _NEIGHBOURS)
                depth.reshape(-1)[pixels[alone]] = np.nan
        points = np.empty((depth.size, 3))
        sure, sigma = np.empty(depth.size, np.float32), np.empty(depth.size, np.float32)
        n = _kernels._place(
            depth, depth_map.confidence, depth_map.sigma, intrinsics_of(self.camera),
            depth_map.pose, points, sure, sigma,
        )  # fmt: skip
        return points[:n], sure[:n], sigma[:n]

    def _patch(self, points: F64, confidence: F32, sigma: F32) -> Patch:
        height = (points[:, 2] - self.settings.surface_z_m).astype(np.float32)
        return Patch(points, height, confidence, sigma)


def radius_filter(points: F64, radius_m: float, neighbours: int) -> npt.NDArray[np.bool_]:
    """Points that have at least `neighbours` others within a radius.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 3)
        Metres.
    radius_m : float
        Radius, metres.
    neighbours : int
        Others that a point needs.
    """
    from scipy.spatial import cKDTree  # takes as long to load as a scan to stitch

    tree = cKDTree(points)
    counts = tree.query_ball_point(points, radius_m, return_length=True)
    return np.asarray(counts - 1 >= neighbours)
