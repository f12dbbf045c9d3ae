"""Merging points in voxels, weighted by what they are sure of, with what has passed let go."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose

from . import _voxel_kernels as _kernels

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]

# Bits of a cell's three indices, signed, around the first point: of a plate metres long the height
# needs the fewest.
_BITS = np.array([24, 24, 15])
#: Cells in each direction from the first point that have a number of their own.
REACH = 1 << (_BITS - 1)
#: No point is surer than this, m.
_LEAST_SIGMA_M = 1e-6
#: A place further from the base's origin is nonsense, m.
_FURTHEST_M = 1e7


class VoxelMap:
    """Means of points in voxels, by what each is sure of.

    It holds what is in view: voxels further from each other than numbers reach never meet.

    Parameters
    ----------
    voxel_m : float
        Edge of a voxel, metres.
    axes : ndarray of float64, shape (3, 3), optional
        Directions of its edges, as columns; else those of the points.
    layer_m : float, optional
        Its edge along the last of them; else as the others.
    """

    def __init__(
        self, voxel_m: float, axes: F64 | None = None, layer_m: float | None = None
    ) -> None:
        self.axes = np.eye(3) if axes is None else axes
        self._edges_m = np.array([voxel_m, voxel_m, layer_m or voxel_m])
        self._origin: F64 | None = None
        self._keys = np.empty(0, np.int64)
        # Columns: weight, weight·(x, y, z) from the origin, weight·confidence, weight·sigma, last
        # touched. Points weigh 1 / sigma². Sigma is no less for several views: what they err by,
        # they err by together.
        self._sums = np.empty((0, 7))
        self._round = 0

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, points: F64, confidence: F32, sigma: F32) -> int:
        """Merge points, shape (n, 3), metres, with confidences and uncertainties, shape (n,).

        Returns
        -------
        int
            Points left out because they are not finite or absurdly far.
        """
        self._round += 1
        if self._origin is None and not self._begin(points, confidence, sigma):
            return len(points)
        keys = np.empty(len(points), np.int64)
        count = _kernels._number(
            points, confidence, sigma, _FURTHEST_M, self._origin, self.axes, self._edges_m, _BITS,
            keys,
        )  # fmt: skip
        order = np.argsort(keys)[len(keys) - count :]
        unique, sums = np.empty(count, np.int64), np.empty((count, 7))
        found = _kernels._sum(
            order, keys, points, confidence, sigma, self._origin, _LEAST_SIGMA_M, self._round,
            unique, sums,
        )  # fmt: skip
        self._merge(unique[:found], sums[:found])
        return len(points) - int(count)

    def _begin(self, points: F64, confidence: F32, sigma: F32) -> bool:
        """Settle where voxels begin by the first points; False where there is none."""
        good = all_of(np.abs(points) < _FURTHEST_M)  # NaN isn't
        good &= np.isfinite(confidence) & np.isfinite(sigma)
        if not good.any():
            return False
        # In the middle of a layer: the surface around it stays in one. On a grid, so that where
        # voxels begin doesn't hang on single points.
        edge_m = self._edges_m[0]
        corner = np.rint(np.median(points[good], axis=0) @ self.axes / edge_m) * edge_m
        corner[2] -= 0.5 * self._edges_m[2]
        self._origin = np.asarray(self.axes @ corner, np.float64)
        return True

    def points(self) -> tuple[F64, F32, F32]:
        """Merged points, shape (n, 3), metres, their confidences and sigmas, shape (n,)."""
        return self._means(self._sums)

    def near(self, low: F64, high: F64) -> F64:
        """Merged points within an axis-aligned box, shape (n, 3), metres."""
        points = np.empty((len(self) + 1, 3))
        if self._origin is None:
            return points[:0]
        return points[: _kernels._near(self._sums, self._origin, low, high, points)]

    def in_view(self, camera: Camera, pose: F64) -> npt.NDArray[np.bool_]:
        """Which merged points a camera at a pose in base sees, in the order of `points`."""
        seen = np.empty(len(self), np.bool_)
        if self._origin is not None:
            shape = camera.height, camera.width
            _kernels._see(
                self._sums, self._origin, intrinsics_of(camera), shape, inverse_pose(pose), seen
            )
        return seen

    def settle(self, keep: npt.NDArray[np.bool_]) -> tuple[F64, F32, F32]:
        """Take out the voxels not to be kept and return their points, as `points` does.

        Parameters
        ----------
        keep : ndarray of bool, shape (n,)
            In the order of `points`.
        """
        gone = len(keep) - int(np.count_nonzero(keep))
        points = np.empty((gone, 3))
        sure, sigma = np.empty(gone, np.float32), np.empty(gone, np.float32)
        if self._origin is not None:
            n = _kernels._settle(self._keys, self._sums, keep, self._origin, points, sure, sigma)
            self._keys, self._sums = self._keys[:n], self._sums[:n]
        return points, sure, sigma

    def oldest(self, count: int) -> npt.NDArray[np.bool_]:
        """Mask of all but the `count` voxels that were touched longest ago."""
        keep = np.ones(len(self), bool)
        keep[np.argsort(self._sums[:, 6], kind="stable")[:count]] = False
        return keep

    def _merge(self, keys: I64, sums: F64) -> None:
        size = len(self._keys) + len(keys)
        out_keys, out_sums = np.empty(size, np.int64), np.empty((size, 7))
        n = _kernels._join(self._keys, self._sums, keys, sums, out_keys, out_sums)
        self._keys, self._sums = out_keys[:n], out_sums[:n]

    def _means(self, sums: F64) -> tuple[F64, F32, F32]:
        if not len(sums) or self._origin is None:
            return np.empty((0, 3)), np.empty(0, np.float32), np.empty(0, np.float32)
        means = sums[:, 1:6] / sums[:, :1]
        sure, sigma = means[:, 3:].astype(np.float32).T
        return means[:, :3] + self._origin, sure, sigma


def intrinsics_of(camera: Camera) -> tuple[float, float, float, float]:
    """What kernels take of a camera."""
    return camera.fx, camera.fy, camera.cx, camera.cy


def all_of(said: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Whether all of a row of three hold, shape (n,): numpy's own is slow on short rows."""
    return said[:, 0] & said[:, 1] & said[:, 2]


def cell_key(cells: I64) -> I64:
    """One number for each cell, shape (n,); cells, shape (n, 3), beyond `REACH` start again."""
    c = (cells + REACH) & ((1 << _BITS) - 1)
    return np.asarray((((c[:, 0] << _BITS[1]) | c[:, 1]) << _BITS[2]) | c[:, 2])


def cells_of_keys(keys: I64) -> I64:
    """Cells of their numbers, shape (n, 3)."""
    c = np.stack([keys >> (_BITS[1] + _BITS[2]), keys >> _BITS[2], keys], axis=1)
    return np.asarray((c & ((1 << _BITS) - 1)) - REACH)
