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
