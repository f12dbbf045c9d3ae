"""Kernels of the sweep in the surface's frame against slow forms."""

from __future__ import annotations

import cv2
import numpy as np

from roller_core.transforms import pose_matrix, rotation_vector_to_quaternion
from roller_emvs.surface import _kernels
from roller_emvs.surface._kernels import GRID_PX


def some_rays(n: int, rng: np.random.Generator) -> np.ndarray:
    return np.column_stack(
        [rng.uniform(-3, 45, n), rng.uniform(-3, 35, n), rng.normal(0, 4000, (n, 2))]
    ).astype(np.float32)


def test_rays_meet_the_plane() -> None:
    rng = np.random.default_rng(0)
    pixels = rng.uniform(-0.3, 0.3, (20, 30, 2)).astype(np.float32)
    x, y = rng.integers(0, 30, 50).astype(np.uint16), rng.integers(0, 20, 50).astype(np.uint16)
    t = np.sort(rng.integers(1000, 9000, 50))
    first = pose_matrix(np.array([0.01, 0.002, 0.0]), rotation_vector_to_quaternion([0, 0.1, 0.0]))
    second = pose_matrix(
        np.array([0.012, 0.001, 0.001]), rotation_vector_to_quaternion([0.02, 0.1, 0.01])
    )
    out = np.empty((4, 50))
    _kernels._place(
        x, y, t, pixels, 1000, 9000, first[:3, 3], second[:3, 3], first[:3, :3], second[:3, :3],
        0.045, out,
    )  # fmt: skip
    for i in range(50):
        pose = first + (t[i] - 1000) / 8000 * (second - first)
        d = pose[:3, :3] @ [*pixels[y[i], x[i]].astype(float), 1.0]
        point = pose[:3, 3] + d / d[2] * (0.045 - pose[2, 3])
        np.testing.assert_allclose(out[:, i], [*point[:2], *(d / d[2])[:2]], atol=1e-12)


def test_a_ray_that_looks_away_has_no_place() -> None:
    away = np.diag([1.0, -1.0, -1.0])
    out = np.empty((4, 1))
    zero = np.zeros(1, np.uint16)
    _kernels._place(
        zero, zero, np.zeros(1, np.int64), np.zeros((1, 1, 2), np.float32), 0, 1,
        np.zeros(3), np.zeros(3), away, away, 0.045, out,
    )  # fmt: skip
    assert np.isnan(out).all()


def test_votes_are_bilinear() -> None:
    rays = some_rays(300, np.random.default_rng(1))
    rays[7, 0] = np.nan
    image, expected = np.zeros((30, 40), np.float32), np.zeros((30, 40))
    _kernels._vote(rays, 5, 290, np.float32(0.0007), image)
    for x, y, sx, sy in rays[5:290]:
        a, b = np.float32(x + sx * np.float32(0.0007)), np.float32(y + sy * np.float32(0.0007))
        if not (0 <= a < 39 and 0 <= b < 29):
            continue
        i, j = int(b), int(a)
        fa, fb = a - j, b - i
        expected[i : i + 2, j : j + 2] += np.outer([1 - fb, fb], [1 - fa, fa])
    np.testing.assert_allclose(image, expected, atol=2e-3)
    assert image.sum() > 50


def test_energy_is_the_squared_sobel_derivative() -> None:
    votes = np.random.default_rng(2).gamma(1.0, 2.0, (32, 48)).astype(np.float32)
    slope = cv2.Sobel(votes, cv2.CV_32F, 1, 0) ** 2
    slope[[0, -1]] = 0
    slope[:, [0, -1]] = 0
    cells = slope.reshape(32 // GRID_PX, GRID_PX, 48 // GRID_PX, GRID_PX).sum(axis=(1, 3))
    found = np.ones_like(cells)
    _kernels._add_energy(votes, found)
    np.testing.assert_allclose(found, cells + 1, rtol=1e-3)


def test_peak_is_searched_between_limits_and_refused_at_them() -> None:
    k = np.arange(20, dtype=np.float32)[:, None, None]
    scores = np.exp(-((k - 5.3) ** 2) / 4) + 2 * np.exp(-((k - 14.6) ** 2) / 4)
    scores = np.repeat(scores, 4, axis=2).astype(np.float32)
    first, last = np.array([[1, 2, 7, 1]]), np.array([[18, 9, 11, 0]])
    peak, contrast = np.empty((1, 4), np.float32), np.empty((1, 4), np.float32)
    _kernels._find_peak(scores, first, last, peak, contrast)
    # The highest of all; the prior's; none, as the scores rise at the limit; none to search.
    np.testing.assert_allclose(peak[0, :2], [14.6, 5.3], atol=0.05)
    assert np.isnan(peak[0, 2:]).all()
    assert contrast[0, 0] > contrast[0, 1]


def test_events_gather_on_the_surface_that_they_meet() -> None:
    rng = np.random.default_rng(3)
    depth = np.tile((1e-5 * np.arange(40) - 2e-4).astype(np.float32), (30, 1))
    depth[:, 30:] = np.nan
    true_x, true_y = rng.integers(5, 28, 500), rng.integers(5, 25, 500)
    slopes = rng.normal(0, 4000, (500, 2))
    shift = depth[true_y, true_x][:, None]
    rays = np.column_stack([np.column_stack([true_x, true_y]) - slopes * shift, slopes])
    support, expected = np.zeros((30, 40), np.float32), np.zeros((30, 40))
    _kernels._warp(rays.astype(np.float32), 0, 500, depth, np.float32(0), support)
    np.add.at(expected, (true_y, true_x), 1)
    np.testing.assert_array_equal(support, expected)
