"""Search for peaks over planes, against slow forms."""

import numpy as np
import pytest

from roller_emvs.evidence import _peak_kernels


def find_peak(
    scores: np.ndarray,
    first: np.ndarray | None = None,
    last: np.ndarray | None = None,
    rival: float = 2.0,
    weakest: float = 0.0,
    least: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Peak, contrast and top of every cell; all planes are searched unless limits are given."""
    planes, *cells = scores.shape
    first = np.zeros(cells, np.int32) if first is None else first.astype(np.int32)
    last = np.full(cells, planes - 1, np.int32) if last is None else last.astype(np.int32)
    out = tuple(np.empty(cells, np.float32) for _ in range(3))
    scores = scores.astype(np.float32)
    _peak_kernels._find_peak(scores, first, last, rival, float(weakest), float(least), *out)
    return out[0], out[1], out[2]


def test_peak_is_searched_between_limits_and_refused_at_them() -> None:
    k = np.arange(20, dtype=np.float32)[:, None, None]
    scores = np.exp(-((k - 5.3) ** 2) / 4) + 2 * np.exp(-((k - 14.6) ** 2) / 4)
    scores = np.repeat(scores, 4, axis=2).astype(np.float32)
    first, last = np.array([[0, 2, 7, 1]]), np.array([[19, 9, 11, 0]])
    peak, contrast, top = find_peak(scores, first, last)
    # The highest of all; the other within limits; none: scores rise at the limit; none to search.
    np.testing.assert_allclose(peak[0, :2], [14.6, 5.3], atol=0.05)
    assert np.isnan(peak[0, 2:]).all()
    for j in range(2):
        searched = scores[first[0, j] : last[0, j] + 1, 0, j]
        expected = 1 - searched.mean() / searched.max()
        assert contrast[0, j] == pytest.approx(expected, rel=1e-4)
        assert top[0, j] == searched.max()


def test_peak_between_planes_is_the_parabolas() -> None:
    k = np.arange(12, dtype=np.float32)
    true = np.array([[3.2, 7.75], [5.0, 0.0]])
    scores = np.maximum(20 - (k[:, None, None] - true) ** 2, 0)
    peak, contrast, _ = find_peak(scores)
    np.testing.assert_allclose(peak[0], true[0], atol=1e-3)
    assert peak[1, 0] == 5.0
    # A peak on the first plane may lie outside the range: none.
    assert np.isnan(peak[1, 1])
    assert contrast[1, 1] == 0
    flat = np.ones_like(scores)
    flat[5:] = 0.5
    assert np.isfinite(find_peak(flat)[0]).all()


def test_a_second_peak_as_high_leaves_no_depth() -> None:
    k = np.arange(30, dtype=np.float32)[:, None, None]
    for height, known in ((0.8, True), (0.95, False)):
        scores = np.exp(-((k - 8) ** 2) / 4) + height * np.exp(-((k - 21) ** 2) / 4)
        assert np.isfinite(find_peak(scores, rival=0.9)[0][0, 0]) == known
    # A broad top with a dent is one peak.
    dented = np.exp(-((k - 15) ** 2) / 40) * (1 - 0.05 * (k == 16))
    assert np.isfinite(find_peak(dented, rival=0.9)[0][0, 0])


def test_a_weak_or_faint_peak_is_none() -> None:
    k = np.arange(20, dtype=np.float32)[:, None, None]
    scores = (1 + 3 * np.exp(-((k - 8) ** 2) / 4)).astype(np.float32)
    expected = 1 - scores.mean() / scores.max()
    for weakest, least, known in (
        (3.9, 0.0, True), (4.1, 0.0, False),
        (0.0, expected - 0.01, True), (0.0, expected + 0.01, False),
    ):  # fmt: skip
        peak, contrast, _ = find_peak(scores, weakest=weakest, least=least)
        assert np.isfinite(peak[0, 0]) == known
        # How faint it is stays known; of one too weak nothing is.
        assert contrast[0, 0] == pytest.approx(expected if weakest < 4 else 0.0, rel=1e-4)


def test_centroids_are_weighted_means() -> None:
    rng = np.random.default_rng(4)
    values = rng.gamma(1.0, 1.0, (3, 9, 11)).astype(np.float32)
    plane = rng.integers(-1, 3, (9, 11))
    peak = np.where(plane < 0, np.nan, plane + rng.uniform(-0.4, 0.4, (9, 11))).astype(np.float32)
    weights = np.array([0.2, 0.6, 0.2], np.float32)
    total, x, y = (np.empty((9, 11), np.float32) for _ in range(3))
    _peak_kernels._centroids(values, peak, weights, total, x, y)
    for i in range(9):
        for j in range(11):
            if plane[i, j] < 0:
                assert total[i, j] == 0
                continue
            e = ex = ey = 0.0
            for a in range(max(i - 1, 0), min(i + 2, 9)):
                for b in range(max(j - 1, 0), min(j + 2, 11)):
                    w = weights[a - i + 1] * weights[b - j + 1] * values[plane[i, j], a, b]
                    e, ex, ey = e + w, ex + w * b, ey + w * a
            np.testing.assert_allclose(
                [total[i, j], x[i, j], y[i, j]], [e, ex / e, ey / e], rtol=1e-4
            )


def test_rows_are_searched_on_the_planes_of_their_cells() -> None:
    first = np.array([[3, 1, 2], [5, 6, 7], [-9, 4, 0]], np.int32)
    last = np.array([[4, 9, -1], [-1, -1, -1], [-3, 5, 2]], np.int32)
    spans = np.empty((3, 2), np.int32)
    _peak_kernels._rows_searched(first, last, spans)
    np.testing.assert_array_equal(spans[[0, 2]], [[1, 9], [0, 5]])
    assert spans[1, 0] > spans[1, 1]
