"""The kernel of the sweep in the surface's frame against a slow form."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import pose_matrix, rotation_vector_to_quaternion
from roller_emvs.surface import _kernels


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
