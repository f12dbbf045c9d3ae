"""Kernels of focus against slow forms."""

from __future__ import annotations

import cv2
import numpy as np

from roller_emvs import focus


def test_gradient_energy_is_the_squared_sobel_derivative() -> None:
    votes = np.random.default_rng(0).gamma(1.0, 2.0, (45, 67)).astype(np.float32)
    du = cv2.Sobel(votes, cv2.CV_32F, 1, 0)
    dv = cv2.Sobel(votes, cv2.CV_32F, 0, 1)
    along = (np.float32(0.8), np.float32(-0.6))
    energy = (along[0] * du + along[1] * dv) ** 2
    energy[[0, -1]] = 0
    energy[:, [0, -1]] = 0
    g = focus.GRID_PX
    rows, columns = -(-45 // g), -(-67 // g)
    padded = np.zeros((rows * g, columns * g))
    padded[:45, :67] = energy
    expected = padded.reshape(rows, g, columns, g).sum(axis=(1, 3))
    found = np.empty((rows, columns), np.float32)
    focus._gradient_energy(votes, *along, found)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_peak_between_planes_is_the_parabolas() -> None:
    k = np.arange(12, dtype=np.float32)
    true = np.array([[3.2, 7.75], [5.0, 0.0]])
    scores = np.maximum(20 - (k[:, None, None] - true) ** 2, 0).astype(np.float32)
    peak, contrast = np.empty((2, 2), np.float32), np.empty((2, 2), np.float32)
    focus._find_peak(scores, peak, contrast)
    np.testing.assert_allclose(peak[0], true[0], atol=1e-3)
    assert peak[1, 0] == 5.0
    # A peak on the first plane may lie outside the range: none.
    assert np.isnan(peak[1, 1])
    assert contrast[1, 1] == 0
    expected = 1 - scores[:, 0, 0].mean() / scores[:, 0, 0].max()
    np.testing.assert_allclose(contrast[0, 0], expected, rtol=1e-5)


def test_flat_scores_give_no_peak() -> None:
    scores = np.ones((9, 3, 3), np.float32)
    peak, contrast = np.empty((3, 3), np.float32), np.empty((3, 3), np.float32)
    focus._find_peak(scores, peak, contrast)
    assert np.isnan(peak).all()


def test_parallax_direction_follows_the_motion() -> None:
    t = np.linspace(0, 1, 20)[:, None]
    for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.3], [0.6, -0.8, 0.0]):
        u, v = focus.parallax_direction(t * np.array([axis]) * 0.01)
        planar = np.array(axis[:2]) / np.linalg.norm(axis[:2])
        assert abs(abs(u * planar[0] + v * planar[1]) - 1) < 1e-6


def test_events_are_warped_to_the_depth_they_meet() -> None:
    """Against a slow form: each ray walks to the pixel whose depth it meets."""
    rng = np.random.default_rng(1)
    n, height, width = 400, 40, 60
    u, v = (rng.uniform(0, s, n).astype(np.float32) for s in (width, height))
    starts = np.array([0, 150, 400])
    centres = np.array([[0.001, 0.0, 0.0], [-0.002, 0.0005, 0.0003]])
    depth = (0.045 + 0.0005 * np.sin(np.arange(width) / 9.0))[None, :].repeat(height, axis=0)
    depth = depth.astype(np.float32)
    depth[10:14] = np.nan
    fx = fy = 300.0
    cx, cy = 29.5, 19.5
    image = np.zeros((height, width), np.float32)
    focus._warp_to_depth(u, v, starts, centres, depth, 0.045, fx, fy, cx, cy, image)
    expected = np.zeros_like(image)
    for k in range(2):
        for i in range(starts[k], starts[k + 1]):
            z, pixel = 0.045, None
            for _ in range(3):
                a = 1 - centres[k, 2] / z
                x = round(np.floor((u[i] - cx) * a + cx + fx * centres[k, 0] / z + 0.5))
                y = round(np.floor((v[i] - cy) * a + cy + fy * centres[k, 1] / z + 0.5))
                pixel = (y, x) if 0 <= x < width and 0 <= y < height else None
                if pixel is None or np.isnan(depth[pixel]):
                    break
                z = float(depth[pixel])
            if pixel is not None:
                expected[pixel] += 1
    np.testing.assert_array_equal(image, expected)
