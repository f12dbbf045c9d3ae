"""Lines through the events of features: analytic places and heights, and twins of the loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roller_core.errors import SettingsError
from roller_emvs.evidence import Relief
from roller_emvs.evidence.field import ground
from roller_emvs.lines import _kernels as kernels
from roller_emvs.lines import _place_kernels as places
from roller_emvs.lines.edge_drift import (
    SLOPE_BINS,
    EdgeDriftSettings,
    TravellingLight,
    drift_of_wider,
    drift_terms,
    edge_drift,
    facing,
)
from roller_emvs.lines.fit import ROW_STEP, Lines, fit_lines
from roller_emvs.lines.follow import _around, move_points, widen_sigma
from roller_emvs.lines.line_points import LinePoints

PIXEL_M = 4.2e-5
SHAPE = (40, 60)


def events_of_line(
    rng: np.random.Generator, x: float, tilt: float, z_m: float, noise_px: float, count: int = 12000
) -> np.ndarray:
    """Rays of a feature at column x of row 0 and a depth; px, slopes px by metre."""
    slope = rng.uniform(-0.3, 0.3, count) / PIXEL_M
    y = rng.uniform(0, SHAPE[0] - 1, count)
    at = x + tilt * y + rng.normal(0, noise_px, count)
    return np.column_stack([at - slope * z_m, y, slope, np.zeros(count)]).astype(np.float32)


def found_lines(rays: np.ndarray, surface_m: float = 0.0) -> Lines:
    surface = np.full(SHAPE, surface_m, np.float32)
    return fit_lines(rays, surface, (0, SHAPE[1]), 1.0, PIXEL_M)


@settings(max_examples=25)
@given(
    x=st.floats(15, 40),
    tilt=st.floats(-0.15, 0.15),
    depth_um=st.floats(-150, 150),
    seed=st.integers(0, 1000),
)
def test_a_line_is_found_where_it_lies_and_as_surely_as_it_says(
    x: float, tilt: float, depth_um: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    rays = events_of_line(rng, x, tilt, depth_um * 1e-6, 0.6)
    lines = found_lines(rays)
    assert len(lines) > 0.8 * SHAPE[0] / ROW_STEP
    middle = (lines.row > 5) & (lines.row < SHAPE[0] - 5)
    error_um = (lines.offset - depth_um * 1e-6)[middle] * 1e6
    sigma_um = np.sqrt(lines.variance[middle, 2]) * 1e6
    # A fit errs by more than its covariance; the floor of a point's sigma, 12 µm, is for that.
    assert np.mean(np.abs(error_um) < 2 * np.hypot(sigma_um, 12.0)) > 0.9
    assert np.median(np.abs(error_um)) < 15
    beside = lines.x[middle] - x - tilt * lines.row[middle]
    assert np.median(np.abs(beside)) < 0.1
    assert np.median(lines.tilt[middle]) == pytest.approx(tilt, abs=0.03)


@pytest.mark.parametrize("noise_px", [0.5, 1.3])
def test_a_line_knows_its_uncertainty_whether_its_band_is_narrow_or_wide(noise_px: float) -> None:
    """Events that spread wider than the fit looks say less than their residuals within it."""
    ratio: list[float] = []
    for seed in range(8):
        rays = events_of_line(np.random.default_rng(seed), 30.0, 0.05, 5e-5, noise_px)
        lines = found_lines(rays)
        ratio.extend((lines.offset - 5e-5) / np.sqrt(lines.variance[:, 2]))
    assert 0.7 < np.sqrt(np.mean(np.square(ratio))) < 1.4


@pytest.mark.parametrize("noise_px", [0.4, 0.8])
def test_a_line_says_how_wide_the_band_of_its_events_is(noise_px: float) -> None:
    rays = events_of_line(np.random.default_rng(2), 30.0, 0.05, 5e-5, noise_px)
    lines = found_lines(rays)
    assert np.median(lines.band) == pytest.approx(noise_px, rel=0.25)


def test_a_band_wider_than_the_window_is_said_to_be_half_of_it() -> None:
    rays = events_of_line(np.random.default_rng(2), 30.0, 0.05, 5e-5, 2.0, 40_000)
    lines = found_lines(rays)
    assert len(lines)
    assert lines.band.max() <= 1.45
    assert np.median(lines.band) > 1.1


def test_events_from_one_direction_give_no_line() -> None:
    rng = np.random.default_rng(1)
    rays = events_of_line(rng, 30.0, 0.0, 0.0, 0.6)
    assert len(found_lines(rays[np.abs(rays[:, 2] * PIXEL_M - 0.2) < 0.05])) == 0


def test_grounding_equals_a_search_for_each_event() -> None:
    rng = np.random.default_rng(3)
    surface = np.full(SHAPE, np.nan, np.float32)
    surface[5:30, 10:50] = 1e-4
    rays = events_of_line(rng, 30.0, 0.1, 1e-4, 8.0, 500)
    pixel, counts = ground(rays, surface)
    for ray, found in zip(rays, pixel, strict=True):
        column = int(np.floor(ray[0] + np.float32(0.5) + ray[2] * np.float32(1e-4)))
        row = int(np.floor(ray[1] + np.float32(0.5)))
        inside = 5 <= row < 30 and 10 <= column < 50
        assert found == (row * SHAPE[1] + column if inside else surface.size)
    np.testing.assert_array_equal(counts, np.bincount(pixel, minlength=len(counts)))
    wanted = np.ones(surface.shape, np.uint8)
    wanted[10, 30], wanted[12] = 0, 0
    starts, place = np.empty((2, len(counts)), np.int32)
    total = kernels._starts(counts, wanted, starts, place)
    counts[:-1] *= wanted.ravel()
    counts[-1] = 0
    assert total == counts.sum()
    np.testing.assert_array_equal(starts, np.cumsum(counts) - counts)
    np.testing.assert_array_equal(place, np.where(counts > 0, starts, -1))
    ordered = np.empty((total, 4), np.float32)
    kernels._by_pixel(rays, pixel, place, ordered)
    kept = counts[pixel] > 0
    expected = rays[kept][np.argsort(pixel[kept], kind="stable")]
    np.testing.assert_array_equal(ordered, expected)


def test_the_robust_fit_equals_reweighted_least_squares() -> None:
    rng = np.random.default_rng(4)
    rays = events_of_line(rng, 30.0, 0.05, 8e-5, 0.7, 3000)
    pixel = np.floor(rays[:, 1] + 0.5).astype(int) * SHAPE[1] + np.floor(rays[:, 0] + 0.5).astype(
        int
    )
    order = np.argsort(pixel, kind="stable")
    rays = np.ascontiguousarray(rays[order])
    starts = np.searchsorted(pixel[order], np.arange(SHAPE[0] * SHAPE[1] + 1))
    out = np.empty((1, 10))
    half, tukey, rounds = np.array([2.9, 4.75]), 2.1, 3
    row, column = np.array([20]), np.array([31])
    kernels._fit_lines(
        rays,
        starts,
        SHAPE[1],
        row,
        column,
        np.zeros(1),
        half,
        tukey,
        rounds,
        10**9,
        out,
    )
    near = (np.abs(np.floor(rays[:, 1] + 0.5) - 20) <= 5) & (
        np.abs(np.floor(rays[:, 0] + 0.5) - 31) <= 4
    )
    x, y, a = rays[near, 0].astype(float) - 31, rays[near, 1].astype(float) - 20, rays[near, 2]
    design = np.column_stack([np.ones(len(x)), a, y]).astype(float)
    within = np.abs(y) <= half[1]
    weight = (within & (np.abs(x) <= half[0])).astype(float)
    beta = np.zeros(3)
    for _ in range(rounds + 1):
        normal = (design * weight[:, None]).T @ design
        rest_before = x - design @ beta
        beta = np.linalg.solve(normal, design.T @ (weight * x))
        last = weight
        weight = within * np.maximum(1 - ((x - design @ beta) / tukey) ** 2, 0) ** 2
    np.testing.assert_allclose(out[0, :3], beta, rtol=1e-5)
    covariance = np.linalg.inv(normal)
    np.testing.assert_allclose(
        out[0, 3:6], [covariance[0, 0], covariance[0, 1], covariance[1, 1]], rtol=1e-4
    )
    assert out[0, 6] == pytest.approx(last.sum() ** 2 / (last**2).sum(), rel=1e-6)
    u2 = np.minimum((rest_before / tukey) ** 2, 1)
    psi, slope = (1 - u2) ** 2 * rest_before, (1 - u2) * (1 - 5 * u2)
    robust = (within * psi**2).sum() / (within * slope).sum() ** 2
    assert out[0, 9] / last.sum() == pytest.approx(robust, rel=1e-4)


def test_ridges_and_votes_equal_plain_words() -> None:
    rng = np.random.default_rng(5)
    density = rng.random((9, 30)).astype(np.float32)
    row, column = (np.empty(200, np.int64) for _ in range(2))
    n = kernels._ridges(density, 0.3, 0.8, 3, 2, row, column)
    expected = [
        (y, x)
        for y in range(0, 9, 2)
        for x in range(1, 29)
        if density[y, x]
        >= max(0.3, density[y, x - 1], 0.8 * density[y, max(x - 3, 0) : x + 4].max())
        and density[y, x] > density[y, x + 1]
    ]
    assert list(zip(row[:n].tolist(), column[:n].tolist(), strict=True)) == expected
    rows = np.sort(rng.integers(0, 40, 80))
    x, tilt, offset = rng.uniform(0, 6, 80), rng.normal(0, 0.1, 80), rng.normal(0, 1, 80)
    votes, near = np.empty(80), np.empty(80, np.int64)
    ends = np.searchsorted(rows, rows + 6, side="right")
    kernels._vote(rows, x, tilt, offset, ends, 6, 1.5, 64, votes, near)
    for k in range(80):
        along = (np.abs(rows - rows[k]) <= 6) & (
            np.abs(x - x[k] - tilt[k] * (rows - rows[k])) < 1.5
        )
        assert votes[k] == pytest.approx(np.median(offset[along]))
        assert near[k] == along.sum()


def test_means_along_contours_equal_plain_words() -> None:
    rng = np.random.default_rng(6)
    rows = np.sort(rng.integers(0, 60, 90))
    x, tilt, value = rng.uniform(0, 6, 90), rng.normal(0, 0.1, 90), rng.normal(0, 1, 90)
    variance, ends = rng.uniform(0.5, 2, 90), np.searchsorted(rows, rows + 10, side="right")
    mean, left = np.empty(90), np.empty(90)
    kernels._along(rows, x, tilt, value, variance, ends, 10, 1.5, 5.0, mean, left)
    for k in range(90):
        apart = rows - rows[k]
        straight = np.abs(x - x[k] - (tilt + tilt[k]) / 2 * apart) < 1.5
        weight = np.exp(-0.5 * (apart / 5.0) ** 2) / variance * straight * (np.abs(apart) <= 10)
        weight /= weight.sum()
        assert mean[k] == pytest.approx(weight @ value)
        assert left[k] == pytest.approx(weight**2 @ variance)


def drift(max_slope: float = 1.0) -> EdgeDriftSettings:
    coefficients = np.arange(1.0, 5.0) * 1e-5
    residual = np.linspace(1e-5, 4e-5, 4 * SLOPE_BINS)
    return EdgeDriftSettings.create(
        {
            "coefficients_m": coefficients.tolist(),
            "even_m": [2e-5, -3e-5],
            "side_m": [4e-5, -1e-5],
            "residual_m": residual.tolist(),
            "max_slope": max_slope,
        }
    )


@pytest.mark.parametrize("polarity", [0, 1])
def test_drift_is_in_plain_words(polarity: int) -> None:
    """Terms by coefficient; and the table of what is left over, what doesn't show, and doubts."""
    rng, n = np.random.default_rng(4), 200
    bins, by_speed = 4 * SLOPE_BINS, rng.normal(0, 1e-4, 8)
    settings = drift().changed(
        {
            "residual_m": rng.uniform(1e-5, 9e-5, bins).tolist(),
            "by_speed_s": by_speed.tolist(),
            "speeds_m_s": [0.3, 0.1, 0.5],
        }
    )
    slope, change, side = rng.normal(0, 1, n), rng.normal(0, 1, n), rng.uniform(-1, 1, n)
    speed, most = rng.uniform(0.05, 0.7, n), settings.max_slope
    slope[:3], speed[:3] = 0.0, 0.3
    held, v = np.clip(slope, -most, most), np.clip(speed, 0.1, 0.5)
    k = 2 * polarity
    beta = [
        *settings.coefficients_m[k : k + 2],
        settings.even_m[polarity],
        settings.side_m[polarity],
    ]
    beta = np.array(beta) + (v - 0.3)[:, None] * by_speed.reshape(2, 4)[polarity]
    terms = drift_terms(held, change, side)
    height = (terms * beta).sum(axis=1)
    middles = (np.arange(SLOPE_BINS) + 0.5) * most / SLOPE_BINS
    table = np.reshape(settings.residual_m, (2, 2, SLOPE_BINS))[polarity]
    rising, falling = (np.interp(np.abs(slope), middles, row) for row in table)
    unseen = np.abs(beta[:, [1, 3]] * (1 - np.abs(terms[:, [1, 3]]))).max(axis=1)
    sigma = np.sqrt(np.where(slope >= 0, rising, falling) ** 2 + unseen**2 + (0.4 * height) ** 2)
    for over in (np.maximum(np.abs(slope) - most, 0), np.abs(np.log(speed / v))):
        sigma = np.hypot(sigma, over * np.maximum(np.abs(height), sigma))
    found = edge_drift(settings, polarity, slope, change, side, speed)
    np.testing.assert_allclose(found, [height, sigma], rtol=1e-9, atol=1e-15)


def test_a_steep_slope_tells_the_side_where_contrast_does_not() -> None:
    """Up to the slope that drift turns over it is contrast alone, from twice that on the slope."""
    slope, side = np.array([-2.0, -0.2, -0.15, -0.1, 0.0, 0.1, 0.15, 0.2, 2.0]), 0.3
    plain = np.full(len(slope), side)
    np.testing.assert_array_equal(facing(plain, slope, 0.0), plain)
    # Walls that rise face the side -1.
    expected = [1.0, 1.0, 0.65, side, side, side, -0.35, -1.0, -1.0]
    np.testing.assert_allclose(facing(plain, slope, -0.1), expected)
    np.testing.assert_allclose(facing(plain, -slope, 0.1), expected)
    sided = drift().changed({"side_m": [1e-4, 0.0], "sure_slope": -0.1})
    none, turned = np.zeros(len(slope)), facing(plain, slope, -0.1)
    found = edge_drift(sided, 0, slope, none, plain, 0.3)
    by_side = edge_drift(sided.changed({"sure_slope": 0.0}), 0, slope, none, turned, 0.3)
    np.testing.assert_array_equal(found, by_side)


def test_what_lines_are_judged_by_is_in_plain_words() -> None:
    rng, n = np.random.default_rng(8), 300
    surface = rng.normal(0, 1, SHAPE).astype(np.float32)
    surface[rng.random(SHAPE) < 0.3] = np.nan
    changes, sides = rng.normal(0, 1, (2, SHAPE[0] // 4, SHAPE[1] // 4)).astype(np.float32)
    row, x = rng.integers(0, SHAPE[0], n), rng.uniform(-1, SHAPE[1], n)
    offset, variance = rng.normal(0, 1, n), rng.uniform(0, 1, n)
    slope, change, side, sigma = np.empty((4, n))
    places._judge(
        row, x, offset, variance, surface, changes, sides, (-0.7, 0.5), (0.3, 0.6, 0.2, 0.1),
        slope, change, side, sigma,
    )  # fmt: skip
    column = np.clip(np.rint(x).astype(int), 0, SHAPE[1] - 1)
    left, here, right = (
        surface[row, np.clip(column + by, 0, SHAPE[1] - 1)].astype(float) for by in (-4, 0, 4)
    )
    both, one_sided = (right - left) / 8, np.where(np.isnan(left), right - here, here - left) / 4
    along = np.nan_to_num(np.where(np.isnan(left) | np.isnan(right), one_sided, both))
    np.testing.assert_allclose(slope, 0.7 * along, rtol=1e-5, atol=1e-6)
    lacks, steep = np.nan_to_num(here - offset), np.maximum(np.abs(slope), 0.6)
    square = 0.25 * variance + (0.5 * 0.3 * lacks) ** 2 + (0.2 * steep) ** 2 + 0.1**2
    np.testing.assert_allclose(sigma, np.sqrt(square))
    np.testing.assert_array_equal(
        [change, side], [v[row // 4, column // 4] for v in (changes, sides)]
    )


def test_drift_has_an_odd_and_an_even_part_and_stays_beyond_what_was_calibrated() -> None:
    slope = np.array([-2.0, -1.0, -0.3, 0.3, 1.0, 2.0])
    for polarity in (0, 1):
        height, sigma = edge_drift(drift(), polarity, slope, np.sign(slope), np.sign(slope), 0.3)
        even = drift().even_m[polarity] * np.abs(np.tanh(slope / 0.15))
        np.testing.assert_allclose(
            height + height[::-1], 2 * np.array([*even[[1, 1, 2]], *even[[3, 4, 4]]])
        )
        assert height[0] == height[1]
        assert sigma[0] > 1.4 * sigma[1]
    one = drift_terms(np.array([0.5]), np.array([0.2]), np.array([-0.7]))[0]
    np.testing.assert_allclose(one, [0.2, np.tanh(0.5 / 0.15), np.tanh(0.5 / 0.15), -0.7])


def test_an_edge_that_shows_no_side_is_uncertain_by_the_drift() -> None:
    """It may be on a wall all the same; and of what is taken out a part stays in doubt."""
    settings = drift().changed(
        {"coefficients_m": [0.0] * 4, "even_m": [0.0, 0.0], "side_m": [2e-4, 0.0]}
    )
    slope, none = np.full(3, 0.3), np.zeros(3)
    side = np.array([0.0, 0.5, 1.0])
    _, plain = edge_drift(settings, 1, slope, none, side, 0.3)
    height, sigma = edge_drift(settings, 0, slope, none, side, 0.3)
    table = edge_drift(settings.changed({"side_m": [0.0, 0.0]}), 0, slope, none, side, 0.3)[1]
    np.testing.assert_allclose(height, 2e-4 * side)
    added = np.hypot(2e-4 * (1 - side), 0.4 * height)
    np.testing.assert_allclose(sigma, np.hypot(table, added))
    assert np.ptp(plain) == 0


def test_lines_wider_than_any_calibrated_may_drift_further() -> None:
    """As far as they are wider, by polarity and rising or falling; others say nothing of it."""
    widths = [2e-5, 3e-5, 1e-5, 5e-5, 0.0, 0.0, 2e-5, 3e-5]
    settings = drift().changed({"widths_m": widths})
    slope, width = np.array([0.5, 0.5, -0.5, -0.5]), np.array([2.9e-5, 6e-5, 4.9e-5, 6e-5])
    most = np.full(4, 1e-4)
    off = drift_of_wider(settings, 0, slope, width, most)
    np.testing.assert_allclose(off, [0.0, 2e-4, 0.0, 5e-4])
    on = drift_of_wider(settings, 1, slope, width, most)
    np.testing.assert_allclose(on, [0.0, 0.0, 1.45e-4, 2e-4])
    assert not drift_of_wider(drift(), 0, slope, width, most).any()
    with pytest.raises(SettingsError, match="7 widths_m: expected 8"):
        drift().changed({"widths_m": widths[1:]})


def test_points_are_as_unsure_as_the_lines_around_them() -> None:
    none, row = np.zeros(4), np.array([10.0, 12.0, 10.0, 12.0])
    lines = LinePoints(row, np.array([15.0, 15.0, 45.0, 45.0]), *[none] * 9)
    own = np.full(3, 3.0, np.float32)
    surface = np.zeros(SHAPE, np.float32)
    at = np.array([11, 11, 35]), np.array([18.4, 47.0, 5.0])
    found = Relief(
        *at, np.zeros(3), own, own, own, 0 * own, (surface, surface), (surface, surface), surface
    )
    less = widen_sigma(found, lines, np.array([4.0, 4.0, 0.0, 0.0]))
    np.testing.assert_allclose(less.sigma, [5.0, 3.0, 3.0], rtol=1e-3)
    np.testing.assert_array_equal(less.offset, found.offset)


def test_events_say_whether_light_travels() -> None:
    rng = np.random.default_rng(6)
    n, count = 400, 500.0
    spread = np.full(n, 0.03)
    shares = []
    for change in (0.3, 2.5):
        light = TravellingLight()
        assert light.share == 1.0  # nothing is known yet
        k = change * rng.choice([-1, 1], n) + rng.normal(0, np.sqrt(1 / (count * spread)))
        light.add(k * spread, spread, np.full(n, count))
        shares.append(light.share)
    assert shares == [0.0, 1.0]


def points_and_lines(seed: int) -> tuple[np.random.Generator, dict[str, np.ndarray]]:
    """Some points at pixels, and lines."""
    rng = np.random.default_rng(seed)
    pixel = np.sort(rng.choice(SHAPE[0] * SHAPE[1], 900, replace=False))
    row, column = np.divmod(pixel, SHAPE[1])
    return rng, {
        "row": row,
        "column": column,
        "offset": rng.normal(0, 1, len(row)),
        "sigma": rng.uniform(0.1, 2, len(row)).astype(np.float32),
        "sure": rng.random(len(row)).astype(np.float32),
        "line_row": np.sort(rng.integers(0, SHAPE[0], 200)),
        "line_column": rng.uniform(-1, SHAPE[1], 200),
        "line_sigma": rng.uniform(0.1, 2, 200),
        "tilt": rng.normal(0, 0.5, 200),
    }


def plainly_between(sums: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values of the lines' grid at pixels, linear between cells."""
    height, width, _ = sums.shape
    y, x = row / places.GRID_PX, (column - (places.GRID_PX - 1) / 2) / places.GRID_PX
    y, x = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
    down = np.maximum(1 - np.abs(y[:, None] - np.arange(height)), 0)
    along = np.maximum(1 - np.abs(x[:, None] - np.arange(width)), 0)
    return np.einsum("ni,nj,ijv->vn", down, along, sums)


@pytest.mark.parametrize("stiff", [1.0, np.inf])
def test_points_move_as_the_lines_around_say(stiff: float) -> None:
    rng, p = points_and_lines(11)
    row, column = p["line_row"], np.clip(np.rint(p["line_column"]).astype(int), 0, SHAPE[1] - 1)
    weight, move, middle = p["line_sigma"] ** -2, rng.normal(0, 0.5, len(row)), 0.5 * SHAPE[1]
    x = p["line_column"] - middle
    values = weight * np.stack([x**0, move, move**2, x, x**2, move * x])
    size = places.GRID_PX
    sums = np.zeros((SHAPE[0] // size, SHAPE[1] // size, 6), np.float32)
    expected = np.zeros_like(sums)
    places._add_lines(row, column, values, sums)
    np.add.at(expected, (row // size, column // size), values.T)
    np.testing.assert_allclose(sums, expected, rtol=1e-5)
    n, peak, floor = len(p["row"]), 20.0, 0.04
    moved, unsure = np.empty(n), np.empty(n, np.float32)
    at, limits = (p["row"], p["column"]), (middle, stiff, peak, floor)
    places._move(*at, p["offset"], p["sigma"], sums, limits, moved, unsure)
    total, *means = plainly_between(sums.astype(np.float64), *at)
    mean, square, x, xx, shared = np.array(means) / np.maximum(total, 1e-30)
    apart = np.maximum(square - mean**2, 0)
    slope = (shared - mean * x) / (np.maximum(xx - x**2, 0) + stiff)
    by = mean + slope * (p["column"] - middle - x)
    own = 1 / np.maximum(total * peak, 1e-30) + floor
    gain = p["sigma"] ** 2 / (p["sigma"] ** 2 + own)
    left = np.minimum(p["sigma"] ** 2, np.maximum((1 - gain) * p["sigma"] ** 2, own))
    sigma = np.sqrt(left + np.sqrt(gain) * apart + ((1 - gain) * by) ** 2)
    np.testing.assert_allclose(moved, p["offset"] + gain * by, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(unsure, sigma, rtol=1e-3, atol=1e-3)


def test_foot_and_top_of_a_wall_move_apart() -> None:
    """Which a mean of the lines around would level."""
    surface, rows = np.zeros(SHAPE, np.float32), np.arange(0, SHAPE[0], 2)
    row = np.tile(rows, 2).astype(np.float64)
    zero = np.zeros(len(row))
    foot, top = 22, 26
    lines = LinePoints(
        row, np.repeat([foot, top], len(rows)).astype(float), zero, zero.astype(int), *[zero] * 7
    )
    offset, sigma = np.repeat([-20e-6, 20e-6], len(rows)), np.full(len(row), 5e-6)
    x = np.arange(20, 29)
    own = np.full(len(x), 1e-4, np.float32)
    found = Relief(
        np.full(len(x), SHAPE[0] // 2), x, np.zeros(len(x)), own, own, own, 0 * own,
        (surface, surface), (surface, surface), surface,
    )  # fmt: skip
    moved = move_points(found, lines, offset, sigma, 1.0).offset
    np.testing.assert_allclose(moved[x == (foot + top) // 2], 0.0, atol=1e-6)
    assert -20e-6 < moved[x == foot] < -12e-6
    assert 12e-6 < moved[x == top] < 20e-6


def test_what_is_around_a_place_is_a_gaussian_of_the_lines() -> None:
    """On a coarser grid, and yet the neighbourhood is no wider."""
    shape, spread = (80, 96), 4.0
    rows, columns = np.meshgrid([30.0], np.arange(40.0, 56.0), indexing="ij")
    some = np.zeros(rows.size)
    lines = LinePoints(rows.ravel(), columns.ravel(), *[some] * 9)
    i, j = (v.ravel() for v in np.meshgrid(np.arange(20, 40), np.arange(35, 60), indexing="ij"))
    around = _around(lines, np.ones((2, rows.size)), shape, i, j)
    corners = np.array([0, 79]), np.array([0, 95])
    everywhere = _around(lines, np.ones((2, rows.size)), shape, *corners)
    cells = np.ix_(np.arange(20, 41) // places.GRID_PX, np.arange(34, 61) // places.GRID_PX)
    np.testing.assert_allclose(around[cells], everywhere[cells], rtol=1e-5)
    found = plainly_between(around.astype(np.float64), i, j)[0] / places.GRID_PX**2
    apart = (i[:, None] - rows.ravel()) ** 2 + (j[:, None] - columns.ravel()) ** 2
    expected = np.exp(-0.5 * apart / spread**2).sum(axis=1) / (2 * np.pi * spread**2)
    np.testing.assert_allclose(found, expected, rtol=0.03, atol=0.01 * expected.max())


def test_a_line_beside_the_surface_leaves_the_points_around_as_they_are() -> None:
    """Where its polarity has no surface it says nothing of how far points are off."""
    surface = np.full(SHAPE, np.nan, np.float32)
    surface[:, :20] = 0.0
    row, zero = np.array([10.0, 10.0]), np.zeros(2)
    lines = LinePoints(row, np.array([10.0, 24.0]), zero, np.zeros(2, np.int64), *[zero] * 7)
    alone = LinePoints(**{name: values[:1] for name, values in lines.__dict__.items()})
    own = np.full(2, 1.0, np.float32)
    place = np.array([10, 10]), np.array([10, 19])
    found = Relief(*place, np.zeros(2), own, own, own, 0 * own, (surface, surface), (), surface)
    offset, sigma = np.array([0.5, 0.7]), np.array([0.1, 0.1])
    moved = move_points(found, lines, offset, sigma, 1.0)
    expected = move_points(found, alone, offset[:1], sigma[:1], 1.0)
    assert (moved.offset > 0.3).all()
    np.testing.assert_array_equal(moved.offset, expected.offset)
    np.testing.assert_array_equal(moved.sigma, expected.sigma)


def test_lines_that_are_surer_than_the_points_beside_them_become_points() -> None:
    _, p = points_and_lines(12)
    row, column, tilt, sigma = (p[k] for k in ("line_row", "line_column", "tilt", "line_sigma"))
    number = np.full(SHAPE, -1, np.int32)
    number[p["row"], p["column"]] = np.arange(len(p["row"]))
    room = 2 * len(row)
    line, to_row, beside = np.empty((3, room), np.int64)
    to_column, most = np.empty(room), np.empty(room + 1, np.float32)
    count = places._surer(
        row, column, tilt, sigma, 2, 1, number, p["sigma"], p["sure"], np.full(SHAPE, np.inf),
        line, to_row, to_column, beside, most,
    )  # fmt: skip
    held = [
        (i, r, c, range(near - 1, near + 2))
        for step in range(2)
        for i, (r, c) in enumerate(zip(row + step, column + tilt * step, strict=True))
        if r < SHAPE[0] and 1 <= (near := int(np.rint(c))) < SHAPE[1] - 1
    ]
    expected = []
    for i, r, c, near in held:
        points = [number[r, j] for j in near if number[r, j] >= 0]
        rivals = [sigma[k] for k, y, _, other in held if y == r and set(other) & set(near)]
        if points and sigma[i] <= min(rivals) and sigma[i] < min(p["sigma"][points]):
            best = points[int(np.argmin(p["sigma"][points]))]
            expected.append((i, r, c, best, p["sure"][points].max()))
    assert 20 < count == len(expected)
    for own, values in zip((line, to_row, to_column, beside, most), zip(*expected, strict=True),
                           strict=True):  # fmt: skip
        np.testing.assert_array_equal(own[:count], values)
