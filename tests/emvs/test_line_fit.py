"""Lines fitted to the events of features: analytic places and heights, and twins of the loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roller_emvs.evidence.field import ground
from roller_emvs.lines import _kernels as kernels
from roller_emvs.lines import _robust_kernels as robust_kernels
from roller_emvs.lines.fit import ROW_STEP, TEXTURE_ROW_STEP, Lines, fit_lines
from roller_emvs.lines.ray_source import RayArray

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


def found_lines(rays: np.ndarray, direction: float = 1.0, row_step: int = ROW_STEP) -> Lines:
    surface = np.zeros(SHAPE, np.float32)
    return fit_lines(RayArray(rays), surface, (0, SHAPE[1]), 1.0, PIXEL_M, direction, row_step)


@settings(max_examples=25)
@given(
    row_step=st.sampled_from([ROW_STEP, TEXTURE_ROW_STEP]),
    x=st.floats(15, 40),
    tilt=st.floats(-0.15, 0.15),
    depth_um=st.floats(-150, 150),
    seed=st.integers(0, 1000),
)
def test_a_line_is_found_where_it_lies_and_as_surely_as_it_says(
    row_step: int, x: float, tilt: float, depth_um: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    rays = events_of_line(rng, x, tilt, depth_um * 1e-6, 0.6)
    lines = found_lines(rays, row_step=row_step)
    assert 0.8 * SHAPE[0] / row_step < len(lines) <= SHAPE[0] / row_step
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
    robust_kernels._fit_lines(
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
        1.0,
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
