"""Merging points in voxels, weighted by what they are sure of, with what has passed let go."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

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
        good = all_of(np.abs(points) < _FURTHEST_M)  # NaN isn't
        good &= np.isfinite(confidence) & np.isfinite(sigma)
        if self._origin is None:
            if not good.any():
                return len(points)
            # In the middle of a layer: the surface around it stays in one. On a grid, so that
            # where voxels begin doesn't hang on single points.
            edge_m = self._edges_m[0]
            corner = np.rint(np.median(points[good], axis=0) @ self.axes / edge_m) * edge_m
            corner[2] -= 0.5 * self._edges_m[2]
            self._origin = np.asarray(self.axes @ corner, np.float64)
        local = points[good] - self._origin
        cells = np.floor(local @ self.axes / self._edges_m).astype(np.int64)
        sure = confidence[good]
        weight = 1.0 / np.square(np.maximum(sigma[good].astype(np.float64), _LEAST_SIGMA_M))
        keys = cell_key(cells)
        unique, inverse = np.unique(keys, return_inverse=True)
        sums = np.zeros((len(unique), 7))
        sums[:, 0] = np.bincount(inverse, weight, len(unique))
        for k, values in enumerate((*local.T, sure, sigma[good]), start=1):
            sums[:, k] = np.bincount(inverse, values * weight, len(unique))
        sums[:, 6] = self._round
        self._merge(unique, sums)
        return int(len(points) - good.sum())

    def points(self) -> tuple[F64, F32, F32]:
        """Merged points, shape (n, 3), metres, their confidences and sigmas, shape (n,)."""
        return self._means(self._sums)

    def places(self) -> F64:
        """Merged points alone, in the order of `points`."""
        if self._origin is None:
            return np.empty((0, 3))
        return self._sums[:, 1:4] / self._sums[:, :1] + self._origin

    def near(self, low: F64, high: F64) -> F64:
        """Merged points within an axis-aligned box, shape (n, 3), metres."""
        points = self.places()
        return points[all_of((points >= low) & (points <= high))]

    def settle(self, keep: npt.NDArray[np.bool_]) -> tuple[F64, F32, F32]:
        """Take out the voxels not to be kept and return their points, as `points` does.

        Parameters
        ----------
        keep : ndarray of bool, shape (n,)
            In the order of `points`.
        """
        gone = self._sums[~keep]
        self._keys, self._sums = self._keys[keep], self._sums[keep]
        return self._means(gone)

    def oldest(self, count: int) -> npt.NDArray[np.bool_]:
        """Mask of all but the `count` voxels that were touched longest ago."""
        keep = np.ones(len(self), bool)
        keep[np.argsort(self._sums[:, 6], kind="stable")[:count]] = False
        return keep

    def _merge(self, keys: I64, sums: F64) -> None:
        place = np.searchsorted(self._keys, keys)
        known = place < len(self._keys)
        known[known] = self._keys[place[known]] == keys[known]
        at = place[known]
        self._sums[at, :6] += sums[known, :6]
        self._sums[at, 6] = self._round
        fresh = ~known
        if fresh.any():
            self._keys = np.insert(self._keys, place[fresh], keys[fresh])
            self._sums = np.insert(self._sums, place[fresh], sums[fresh], axis=0)

    def _means(self, sums: F64) -> tuple[F64, F32, F32]:
        if not len(sums) or self._origin is None:
            return np.empty((0, 3)), np.empty(0, np.float32), np.empty(0, np.float32)
        means = sums[:, 1:6] / sums[:, :1]
        sure, sigma = means[:, 3:].astype(np.float32).T
        return means[:, :3] + self._origin, sure, sigma


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
