"""The kernels of the sweep in the surface's frame against slow forms."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import pose_matrix, rotation_vector_to_quaternion
from roller_emvs.methods.surface import _kernels


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


def some_rays(rng: np.random.Generator, n: int = 400) -> np.ndarray:
    rays = np.stack([rng.uniform(-0.01, 0.02, n), *rng.uniform(-0.3, 0.3, (3, n))])
    rays[:, 7] = np.nan
    return rays


def test_the_span_leaves_out_what_leans_too_far() -> None:
    rays = some_rays(np.random.default_rng(1))
    before = rays.copy()
    low, high, steepest = _kernels._span(rays, 0.2)
    inside = np.abs(before[2]) <= 0.2
    np.testing.assert_array_equal(np.isfinite(rays[0]), inside)
    assert (low, high) == (before[0, inside].min(), before[0, inside].max())
    assert steepest == np.abs(before[2, inside]).max()


def test_rays_go_to_every_block_that_they_can_reach() -> None:
    rng = np.random.default_rng(2)
    rays, n, length, reach = some_rays(rng), 400, 0.004, 0.0015
    polarity, t = rng.integers(0, 2, n).astype(np.uint8), np.sort(rng.integers(0, 10**9, n))
    low, high = -2, 3
    first, last = np.empty(n, np.int64), np.empty(n, np.int64)
    counts = np.zeros(6, np.int64)
    _kernels._find_blocks(rays, reach, length, (low, high), first, last, counts)
    place = np.cumsum(counts) - counts
    begins, starts = place.copy(), np.arange(low, high + 1) * length
    out, signs = np.empty((counts.sum(), 4), np.float32), np.empty(counts.sum(), np.uint8)
    times = np.tile([2**62, -(2**62)], (6, 1))
    _kernels._list_blocks(rays, polarity, t, first, last, starts, place, out, signs, times)
    for k in range(6):
        own = (rays[0] >= starts[k] - reach) & (rays[0] < starts[k] + length + reach)
        held = slice(begins[k], begins[k] + counts[k])
        expected = rays[:, own].T - [starts[k], 0, 0, 0]
        np.testing.assert_allclose(out[held], expected, atol=1e-7)
        np.testing.assert_array_equal(signs[held], polarity[own])
        assert tuple(times[k]) == (t[own].min(), t[own].max())


def test_rays_in_pixels_are_ordered_by_polarity() -> None:
    rng = np.random.default_rng(3)
    rays, polarity = rng.normal(0, 1, (200, 4)).astype(np.float32), rng.integers(0, 2, 200)
    low, high, off = _kernels._rows(rays, polarity)
    assert (low, high) == (rays[:, 1].min(), rays[:, 1].max())
    assert off == np.count_nonzero(polarity == 0)
    corner, pixel = np.array([0.5, low], np.float32), np.float32(0.04)
    place, out = np.array([0, off]), np.empty_like(rays)
    # Part after part.
    _kernels._to_pixels(rays[:90], polarity[:90], corner, pixel, place, out)
    _kernels._to_pixels(rays[90:], polarity[90:], corner, pixel, place, out)
    ordered = np.concatenate([rays[polarity == 0], rays[polarity == 1]])
    np.testing.assert_allclose(out, (ordered - [0.5, low, 0, 0]) / 0.04, rtol=1e-5, atol=1e-4)
