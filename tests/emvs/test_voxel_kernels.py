"""Kernels of the stitched cloud against their numpy twins."""

from __future__ import annotations

import numpy as np
import pytest

from roller_core.camera import Camera
from roller_core.transforms import inverse_pose, pose_matrix, rotation_vector_to_quaternion
from roller_emvs import _voxel_kernels as kernels
from roller_emvs.depth_map import back_project
from roller_emvs.voxels import VoxelMap, all_of, cell_key, intrinsics_of

CAMERA = Camera(40, 30, 90.0, 80.0, 19.7, 14.2)
EDGE_M = 1e-3
POSE = pose_matrix(np.array([0.3, -0.1, 0.5]), rotation_vector_to_quaternion([3.0, 0.2, 0.1]))


def _depth(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    depth, sure, sigma = rng.uniform(0.02, 0.06, (3, 30, 40)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.3] = np.nan
    sure[rng.random(depth.shape) < 0.2] = np.nan
    sure[rng.random(depth.shape) < 0.2] = -1.0
    return depth, sure, sigma


def _cloud(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points = rng.uniform(-4 * EDGE_M, 4 * EDGE_M, (n, 3)) + 0.7
    sure, sigma = rng.uniform(1e-5, 1.0, (2, n)).astype(np.float32)
    points[::17, 1], sure[::19], sigma[::23] = np.nan, np.inf, np.nan
    points[5::29] = 1e8
    return points, sure, sigma


class Twin:
    """`VoxelMap` in numpy."""

    def __init__(self, origin: np.ndarray, axes: np.ndarray, edges: np.ndarray) -> None:
        self.origin, self.axes, self.edges = origin, axes, edges
        self.keys, self.sums, self.round = np.empty(0, np.int64), np.empty((0, 7)), 0

    def add(self, points: np.ndarray, sure: np.ndarray, sigma: np.ndarray) -> int:
        self.round += 1
        good = all_of(np.abs(points) < 1e7) & np.isfinite(sure) & np.isfinite(sigma)
        local = points[good] - self.origin
        cells = np.floor(local @ self.axes / self.edges).astype(np.int64)
        weight = 1.0 / np.square(np.maximum(sigma[good].astype(np.float64), 1e-6))
        unique, inverse = np.unique(cell_key(cells), return_inverse=True)
        sums = np.zeros((len(unique), 7))
        values = (np.ones(len(local)), *local.T, sure[good], sigma[good])
        for k, each in enumerate(values):
            sums[:, k] = np.bincount(inverse, each * weight, len(unique))
        sums[:, 6] = self.round
        keys = np.union1d(self.keys, unique)
        joined = np.zeros((len(keys), 7))
        joined[np.searchsorted(keys, self.keys)] = self.sums
        at = np.searchsorted(keys, unique)
        joined[at, :6] += sums[:, :6]
        joined[at, 6] = self.round
        self.keys, self.sums = keys, joined
        return int((~good).sum())

    def means(self) -> np.ndarray:
        return np.asarray(self.sums[:, 1:6] / self.sums[:, :1] + np.append(self.origin, [0, 0]))


@pytest.fixture(params=[0, 1])
def both(request: pytest.FixtureRequest) -> tuple[VoxelMap, Twin]:
    """A map of three clouds, and its twin."""
    rng = np.random.default_rng(request.param)
    voxels = VoxelMap(EDGE_M, POSE[:3, :3], 4 * EDGE_M)
    twin: Twin | None = None
    for n in (300, 500, 200):
        points, sure, sigma = _cloud(rng, n)
        left_out = voxels.add(points, sure, sigma)
        if twin is None:
            assert voxels._origin is not None
            twin = Twin(voxels._origin, voxels.axes, voxels._edges_m)
        assert twin.add(points, sure, sigma) == left_out > 0
    assert twin is not None
    return voxels, twin


def test_points_are_placed_as_by_the_twin() -> None:
    depth, sure, sigma = _depth(np.random.default_rng(3))
    points, pixels = back_project(depth, CAMERA)
    keep = sure.reshape(-1)[pixels] >= 0.0
    expected = points[keep] @ POSE[:3, :3].T + POSE[:3, 3]
    found = np.empty((depth.size, 3))
    fields = np.empty((2, depth.size), np.float32)
    n = kernels._place(depth, sure, sigma, intrinsics_of(CAMERA), POSE, found, *fields)
    assert n == keep.sum()
    np.testing.assert_allclose(found[:n], expected, rtol=0, atol=1e-15)
    for values, image in zip(fields, (sure, sigma), strict=True):
        np.testing.assert_array_equal(values[:n], image.reshape(-1)[pixels[keep]])


def test_voxels_are_those_of_the_twin(both: tuple[VoxelMap, Twin]) -> None:
    voxels, twin = both
    np.testing.assert_array_equal(voxels._keys, twin.keys)
    np.testing.assert_allclose(voxels._sums, twin.sums, rtol=1e-12)
    assert len(set(voxels._sums[:, 6])) > 1


def test_what_is_near_is_that_of_the_twin(both: tuple[VoxelMap, Twin]) -> None:
    voxels, twin = both
    means = twin.means()[:, :3]
    low, high = np.quantile(means, [0.2, 0.9], axis=0)
    inside = all_of((means >= low) & (means <= high))
    assert 0 < inside.sum() < len(means)
    np.testing.assert_allclose(voxels.near(low, high), means[inside], rtol=0, atol=1e-15)


def test_what_is_in_view_is_that_of_the_twin(both: tuple[VoxelMap, Twin]) -> None:
    voxels, twin = both
    pose = POSE.copy()
    pose[:3, 3] = twin.means()[:, :3].mean(axis=0) - 0.012 * pose[:3, 2]
    to_camera = inverse_pose(pose)
    x, y, z = (twin.means()[:, :3] @ to_camera[:3, :3].T + to_camera[:3, 3]).T
    z = np.maximum(z, 1e-9)
    u = CAMERA.fx * x / z + CAMERA.cx
    v = CAMERA.fy * y / z + CAMERA.cy
    seen = (u >= 0) & (u < CAMERA.width) & (v >= 0) & (v < CAMERA.height)
    assert 0 < seen.sum() < len(seen)
    np.testing.assert_array_equal(voxels.in_view(CAMERA, pose), seen)


def test_what_settles_is_that_of_the_twin(both: tuple[VoxelMap, Twin]) -> None:
    voxels, twin = both
    keep = np.arange(len(voxels)) % 3 > 0
    points, sure, sigma = voxels.settle(keep)
    means = twin.means()[~keep]
    np.testing.assert_allclose(points, means[:, :3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.stack([sure, sigma], 1), means[:, 3:], rtol=1e-6)
    np.testing.assert_array_equal(voxels._keys, twin.keys[keep])
    np.testing.assert_allclose(voxels._sums, twin.sums[keep], rtol=1e-12)


def test_moments_of_neighbours_are_those_of_the_twin() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(0.0, 1e-3, (50, 3))
    which, near = rng.permutation(50)[:20], rng.integers(0, 51, (20, 12))
    near[:, 0] = which
    moments, counts = np.empty((20, 3, 3)), np.empty(20, np.int64)
    kernels._spread(points, which, near, moments, counts)
    for i in range(20):
        own = points[near[i][near[i] < 50]] - points[which[i]]
        assert counts[i] == len(own)
        expected = np.cov(own.T, bias=True) if len(own) > 1 else np.zeros((3, 3))
        np.testing.assert_allclose(moments[i], expected, rtol=0, atol=1e-18)
