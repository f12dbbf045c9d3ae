"""The surface through depths on cells: kernels against plain twins, and what the fit promises."""

import warnings

import numpy as np
import pytest

from roller_emvs.evidence import _fit_kernels as kernels
from roller_emvs.evidence.fit import fit_planes
from roller_emvs.evidence.sweep import Depths

SHAPE = (24, 32)
SIGMA = 1.0
ROWS, COLUMNS = np.indices(SHAPE).astype(np.float32)
INNER = (slice(5, -5), slice(5, -5))


def depths_of(
    offset: np.ndarray, x: np.ndarray, y: np.ndarray, measure: np.ndarray | float = 50.0
) -> Depths:
    full = np.array(np.broadcast_to(measure, SHAPE), np.float32)
    return Depths(
        offset.astype(np.float32), full, full, x.astype(np.float32), y.astype(np.float32), 0 * full
    )


def scattered(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Places of evidence somewhat beside their cells."""
    x, y = COLUMNS + rng.uniform(-0.7, 0.7, SHAPE), ROWS + rng.uniform(-0.7, 0.7, SHAPE)
    return x.astype(np.float32), y.astype(np.float32)


def test_cells_with_a_depth_and_those_of_its_evidence_are_marked() -> None:
    rng = np.random.default_rng(4)
    x, y = COLUMNS + rng.normal(0, 2, SHAPE), ROWS + rng.normal(0, 2, SHAPE)
    z = np.where(rng.random(SHAPE) < 0.05, 1.0, np.nan)
    found, expected = np.zeros((2, *SHAPE), np.bool_)
    kernels._mark(z, x, y, found)
    for i, j in np.argwhere(z == 1.0):
        expected[i, j] = True
        row, column = (
            np.clip(round(v[i, j]), 0, n - 1) for v, n in zip((y, x), SHAPE, strict=True)
        )
        expected[row, column] = True
    np.testing.assert_array_equal(found, expected)


def test_kernels_are_their_plain_twins() -> None:
    rng = np.random.default_rng(0)
    x, y = scattered(rng)
    z = rng.normal(0, 1, SHAPE).astype(np.float32)
    z[rng.random(SHAPE) < 0.3] = np.nan
    measure = rng.uniform(-1, 9, SHAPE).astype(np.float32)
    row, column = np.empty(SHAPE, np.int32), np.empty(SHAPE, np.int32)
    weight, moments = np.empty(SHAPE), np.zeros((9, *SHAPE))
    kernels._weigh(z, x, y, measure, row, column, weight)
    kernels._add_moments(z, x, y, weight, row, column, moments)
    known = np.isfinite(z) & (measure > 0)
    np.testing.assert_array_equal(weight > 0, known)
    w, a, b, c = (v[known].astype(float) for v in (measure, x, y, z))
    w = w**0.75
    place = (
        np.clip(np.rint(b).astype(int), 0, SHAPE[0] - 1),
        np.clip(np.rint(a).astype(int), 0, SHAPE[1] - 1),
    )
    for moment, term in zip(
        moments, (1 + 0 * a, a, b, a * a, a * b, b * b, c, a * c, b * c), strict=True
    ):
        expected = np.zeros(SHAPE)
        np.add.at(expected, place, w * term)
        np.testing.assert_allclose(moment, expected, rtol=1e-6, atol=1e-9)

    again = moments.copy()
    again[kernels.OF_OFFSET] = 0
    kernels._add_offsets(z, x, y, weight, row, column, again)
    np.testing.assert_array_equal(again, moments)

    planes, trust = rng.normal(0, 1, (5, *SHAPE)), rng.uniform(0.5, 2, SHAPE)
    sums = np.zeros((4, *SHAPE))
    kernels._add_residuals(z, x, y, weight, row, column, trust, planes, sums)
    mx, my, mz, sx, sy = (p[place] for p in planes)
    rest = c - mz - sx * (a - mx) - sy * (b - my)
    w = w * trust[place]
    for found, term in zip(sums, (w * rest, w, w * rest * rest, w * w), strict=True):
        expected = np.zeros(SHAPE)
        np.add.at(expected, place, term)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def test_what_planes_and_residuals_give_is_in_plain_words() -> None:
    rng = np.random.default_rng(6)
    w, by_square, rest, squares = rng.uniform(0.5, 2, (4, *SHAPE))
    planes, found = rng.normal(0, 1, (5, *SHAPE)), np.empty(SHAPE)
    kernels._trust(w, squares, 0.3, found)
    np.testing.assert_allclose(found, 0.3 / (squares / w + 0.3))
    kernels._at_cells(planes, (5.0, 7.0), w, rest, 1.5, found)
    x, y, z, along, down = planes
    expected = z + along * (COLUMNS - 5 - x) + down * (ROWS - 7 - y) + 1.5 * rest / w
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    kernels._scatter(w, squares, by_square, found)
    np.testing.assert_allclose(found, np.sqrt(squares / w) * np.sqrt(by_square) / w)


def test_a_plane_is_the_least_squares_one() -> None:
    rng = np.random.default_rng(1)
    a, b, c, w = rng.uniform(0, 9, 40), rng.uniform(0, 9, 40), rng.normal(0, 1, 40), rng.random(40)
    terms = (1 + 0 * a, a, b, a * a, a * b, b * b, c, a * c, b * c)
    moments = np.array([(w * t).sum() for t in terms]).reshape(9, 1, 1)
    planes = np.empty((5, 1, 1))
    kernels._solve(moments, planes)
    design = np.stack([1 + 0 * a, a - w @ a / w.sum(), b - w @ b / w.sum()], axis=1)
    # The stiffness holds slopes back as if samples of height 0 lay at either side.
    ridge = np.diag([0, kernels._STIFFNESS, kernels._STIFFNESS]) * w.sum()
    best = np.linalg.solve(design.T @ (w[:, None] * design) + ridge, design.T @ (w * c))
    expected = [w @ a / w.sum(), w @ b / w.sum(), *best]
    np.testing.assert_allclose(planes[:, 0, 0], expected, rtol=1e-9)


def test_a_plane_is_kept_wherever_its_evidence_lies() -> None:
    x, y = scattered(np.random.default_rng(2))
    fit = fit_planes([depths_of(0.3 * x - 0.2 * y, x, y)], SIGMA, 0.1)
    expected = 0.3 * COLUMNS - 0.2 * ROWS
    np.testing.assert_allclose(fit.offset[INNER], expected[INNER], atol=0.02)


def test_crests_and_hollows_are_given_back() -> None:
    """A plane alone levels a parabola by half its bend times the neighbourhood's variance."""
    bend = 0.2
    offset = 0.5 * bend * (COLUMNS - 16) ** 2
    fit = fit_planes([depths_of(offset, COLUMNS, ROWS)], SIGMA, 0.1)
    levelled = 0.5 * bend * SIGMA**2
    left = (fit.offset - offset)[INNER]
    assert np.abs(left).max() < 0.6 * levelled
    # What evidence has levelled by itself, a neighbourhood as large, is partly given back too.
    assert left.mean() < 0


def test_the_polarity_that_scatters_counts_less() -> None:
    rng = np.random.default_rng(3)
    off = depths_of(1.0 + rng.normal(0, 3, SHAPE), COLUMNS, ROWS)
    on = depths_of(rng.normal(0, 0.1, SHAPE), COLUMNS, ROWS)
    fit = fit_planes([off, on], SIGMA, 0.1)
    assert abs(fit.offset[INNER].mean()) < 0.05
    # The order of the polarities and the number of threads don't matter.
    again = fit_planes([on, off], SIGMA, 0.1, threads=2)
    np.testing.assert_allclose(fit.offset, again.offset, atol=1e-6)


def test_shares_say_by_how_much_each_polarity_counts() -> None:
    """One that is seen alone counts in full, and of two that scatter alike each half."""
    none, level = np.full(SHAPE, np.nan), np.zeros(SHAPE)
    left = np.where(COLUMNS < 16, level, none)
    both = [depths_of(offset, COLUMNS, ROWS) for offset in (left, level)]
    shares = fit_planes(both, SIGMA, 0.1).shares
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, rtol=1e-5)
    np.testing.assert_allclose(shares[0, :, :10], 0.5, rtol=1e-5)
    np.testing.assert_allclose(shares[0, :, 22:], 0.0, atol=1e-6)
    alone = fit_planes([depths_of(left, COLUMNS, ROWS)], SIGMA, 0.1).shares[0]
    np.testing.assert_allclose(alone[:, :16], 1.0, rtol=1e-5)


def test_a_fit_takes_what_hangs_on_places_alone_from_one_before() -> None:
    rng = np.random.default_rng(5)
    x, y = scattered(rng)
    offsets = [rng.normal(0, 1, SHAPE) for _ in range(2)]
    for offset in offsets:
        offset[rng.random(SHAPE) < 0.5] = np.nan
    first = fit_planes([depths_of(o, x, y) for o in offsets], SIGMA, 0.1, scattered=False)
    assert not first.scatter.size
    moved = [depths_of(o + 0.3 * x, x, y) for o in offsets]
    fit, again = fit_planes(moved, SIGMA, 0.1), fit_planes(moved, SIGMA, 0.1, like=first)
    np.testing.assert_array_equal(again.offset, fit.offset)
    np.testing.assert_array_equal(again.scatter, fit.scatter)


@pytest.mark.parametrize("deviation", [0.2, 1.0])
def test_scatter_is_the_deviation_of_the_depths(deviation: float) -> None:
    rng = np.random.default_rng(4)
    offset = rng.normal(0, deviation, SHAPE)
    even = fit_planes([depths_of(offset, COLUMNS, ROWS)], SIGMA, 0.1)
    assert 0.7 * deviation < np.median(even.scatter[INNER]) < 1.2 * deviation


def test_nothing_near_is_no_surface() -> None:
    none = np.full(SHAPE, np.nan)
    one = none.copy()
    one[12, 5] = 2.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(fit_planes([depths_of(none, COLUMNS, ROWS)] * 2, SIGMA, 0.1).offset).all()
        fit = fit_planes([depths_of(none, COLUMNS, ROWS), depths_of(one, COLUMNS, ROWS)], SIGMA, 1)
    assert fit.offset[12, 5] == pytest.approx(2.0)
    assert np.isnan(fit.offset[:, 20:]).all()
