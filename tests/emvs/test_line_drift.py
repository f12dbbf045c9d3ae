"""How far the light lets a line drift, by what it is judged by; in plain words."""

import numpy as np
import pytest

from roller_core.errors import SettingsError
from roller_emvs.lines import _place_kernels as places
from roller_emvs.lines.edge_drift import (
    SLOPE_BINS,
    EdgeDriftSettings,
    drift_of_wider,
    drift_terms,
    edge_drift,
    facing,
)
from roller_emvs.lines.travelling_light import TravellingLight

SHAPE = (40, 60)


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
