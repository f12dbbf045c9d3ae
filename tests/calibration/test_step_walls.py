"""Walls of steps among lines: which are walls, which rise, how high they are, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.made_up_gauges import SCAN, SETTINGS, STEP_M, drift_m, made_up_steps
from roller_calibration import gauge as calibration
from roller_calibration.edge_drift import fit_drift
from roller_calibration.step_gauges import steps_gauges
from roller_calibration.step_walls import (
    find_walls,
    parts_by_kind,
    rising_walls,
    steps_apart,
    wall_levels,
)
from roller_emvs.lines.edge_drift import edge_drift


def test_a_polarity_that_shows_alone_comes_first() -> None:
    """Dark walls: OFF comes first, at the foot of one that rises and the top of one that falls."""
    rising = np.array([True, False])
    across, wall = np.repeat([0.0, 3e-4, 2e-3], 30), np.repeat([0, 0, 1], 30)
    kind = np.repeat([0, 2, 1], 30)
    parts = parts_by_kind(across, wall, kind, rising)
    np.testing.assert_allclose(parts, [-0.4, 0.24, 0.4, -0.24])
    alone = parts_by_kind(across, np.repeat([0, 1, 1], 30), np.repeat([2, 1, 1], 30), rising)
    np.testing.assert_allclose(alone, [0.24, 0.24, -0.24, -0.24])
    both = parts_by_kind(
        np.append(across, across[:30] + 1.7e-3),
        np.append(wall, wall[60:]),
        np.append(kind, np.full(30, 3)),
        rising,
    )
    np.testing.assert_allclose(both, [-0.4, -0.4, 0.4, 0.4])


def test_walls_are_told_by_their_levels_where_drift_makes_all_slope_alike(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Light that darkens all walls once passed: each seems to rise, and lies as much too high."""
    steps = made_up_steps(np.random.default_rng(6), drift=0.0, base_m=0.0, higher_m=1.5e-4)
    own = steps.lines
    seen = replace(own, slope=np.abs(own.slope), side=np.full(len(own.slope), -1.0))
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[replace(steps, lines=seen)]])
    gauge = steps_gauges(SCAN, SETTINGS, STEP_M)[0]
    assert np.mean(gauge.rise == np.sign(own.slope)) > 0.99
    found = fit_drift([gauge])
    slope, side = np.array([0.8]), np.array([-1.0])
    assert found.corrected == (True, True)
    for polarity in (0, 1):
        # On walls nearer to each other than the gauge's the side doesn't show.
        for seen_side in (side, 0 * side):
            height, _ = edge_drift(found.settings, polarity, slope, np.zeros(1), seen_side, 0.1)
            assert height[0] == pytest.approx(1.5e-4, abs=4e-5)


def test_a_polarity_that_gathers_between_walls_is_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It would be a wall more that goes up than go down."""
    steps = made_up_steps(np.random.default_rng(9), base_m=0.0)
    kept = (steps.lines.polarity == 0) | (np.arange(2000) < 300)
    lines, place = calibration.take(steps.lines, kept), steps.place[kept]
    on = lines.polarity == 1
    place[on, 0] = 0.03 + 4.6 * 1.1e-3 + np.radians(1.0) * place[on, 1]
    slope = np.where(on, 0.4, lines.slope)
    strays = replace(steps, place=place, lines=replace(lines, slope=slope))
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[strays]])
    gauge = steps_gauges(SCAN, SETTINGS, STEP_M)[0]
    assert (gauge.lines.polarity == 0).all()
    assert "10 walls of 0.200 mm" in gauge.text


def test_walls_that_seem_level_count_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its level wall the steps above it would be numbered wrong."""
    steps = made_up_steps(np.random.default_rng(7), base_m=0.0)
    slope = steps.lines.slope.copy()
    level = np.abs(steps.place[:, 0] - np.radians(1.0) * steps.place[:, 1] - 0.0322) < 3e-4
    slope[level] = 0.02
    seen = replace(steps, lines=replace(steps.lines, slope=slope))
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[seen]])
    gauge = steps_gauges(SCAN, SETTINGS, STEP_M)[0]
    assert len(gauge.error_m) > 1900
    off = gauge.error_m - drift_m(gauge.lines.polarity, gauge.rise)
    assert np.abs(off).max() < 1e-4


def test_a_wall_that_seems_level_goes_by_its_height_and_not_by_chance() -> None:
    """Where one event tells of a wall no slope shows, of any of them."""
    slopes = [0.13, -0.01, 0.05, 0.1, 0.14, 0.21, 0.12, -0.02]
    levels = [-94, 140, 386, 668, 1026, 775, 527, 279]  # µm; steps of 250
    wall = np.repeat(np.arange(8), 40)
    slope, height = np.repeat(slopes, 40), np.repeat(levels, 40) * 1e-6
    rising, _ = rising_walls(wall, np.zeros(len(wall), np.int64), height, slope, 8, 2.5e-4)
    assert rising.tolist() == [True] * 4 + [False] * 4


def test_a_wall_that_is_no_step_from_its_neighbours_goes_by_the_nearer_climb() -> None:
    """Drift brings the last wall up and the first one down together, by half a step."""
    levels = [199, 434, 685, 935, 797, 629, 370, 131]  # µm; steps of 250
    slopes = [0.06, -0.05, -0.02, 0.0, 0.01, 0.02, -0.02, -0.01]
    wall = np.repeat(np.arange(8), 40)
    slope, height = np.repeat(slopes, 40), np.repeat(levels, 40) * 1e-6
    rising, _ = rising_walls(wall, np.zeros(len(wall), np.int64), height, slope, 8, 2.5e-4)
    assert rising.tolist() == [True] * 4 + [False] * 4


def test_walls_that_drift_has_levelled_go_by_the_heights_of_all() -> None:
    """As an independent ring of light shows them, OFF at their foot where they rise."""
    of_off = [195, 372, 655, 964, 790, 770, 452, 125]  # µm; steps of 250
    of_on = [191, 394, 618, 773, 601, 521, 324, 45]
    slopes = [-0.02, 0.06, 0.08, 0.09, 0.09, 0.15, -0.09, -0.01]
    wall, polarity = np.tile(np.repeat(np.arange(8), 40), 2), np.repeat([0, 1], 320)
    height = np.repeat([*of_off, *of_on], 40) * 1e-6
    for turned in (1, -1):
        slope = turned * np.tile(np.repeat(slopes, 40), 2)
        rising, _ = rising_walls(wall, polarity, height, slope, 8, 2.5e-4)
        assert rising.tolist() == [True] * 4 + [False] * 4
    rising, _ = rising_walls(wall, polarity, -height, slope, 8, 2.5e-4)
    assert rising.tolist() == [False] * 4 + [True] * 4


def test_both_edges_of_a_wall_are_its_own() -> None:
    """A foot and a top 0.2 mm apart, whichever shows more lines."""
    x = np.concatenate([k * 1.8e-3 + np.array([0.0, 2e-4]) for k in range(6)]).repeat(40)
    for more in (0, 1):
        kept = np.flatnonzero((np.arange(len(x)) // 40 % 2 == more) | (np.arange(len(x)) % 2 == 0))
        place, slope = x[kept], np.ones(len(kept))
        wall, count, _ = find_walls(place, 0 * place, slope, 1e-5 * slope, 2.5e-4)
        assert count == 6
        np.testing.assert_array_equal(wall, np.floor(place / 1.8e-3 + 0.5))


def test_lines_further_off_than_a_wall_is_long_are_none_of_it() -> None:
    """Not the wall's other edge, if nearer to it than to the next wall."""
    walls = np.repeat(np.arange(6) * 1.7e-3, 40)
    x = np.concatenate([walls, np.full(40, 1.7e-3 - 0.65e-3)])
    slope, sigma = np.ones(len(x)), np.full(len(x), 1e-5)
    found, count, _ = find_walls(x, 0.0 * x, slope, sigma, 3e-4)
    assert count == 7
    assert (found[-40:] == 1).all()
    assert (found[40:80] == 2).all()
    # A foot and a top are one wall.
    x[-40:] = 1.7e-3 - 0.4e-3
    assert find_walls(x, 0.0 * x, slope, sigma, 3e-4)[1] == 6


def test_walls_that_were_not_seen_are_counted() -> None:
    change = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
    heights = np.array([0.5, 1.5, 2.5, 2.5, 1.5, 0.5])
    np.testing.assert_allclose(wall_levels(heights, change), heights)
    # Drift that lifts all that goes down is none; a wall that hardly stands out counts as one.
    np.testing.assert_allclose(wall_levels(heights + 0.6 * (change < 0), change), heights)
    np.testing.assert_allclose(wall_levels(0.3 * heights, change), heights)
    seen = np.array([0, 2, 4, 5])
    np.testing.assert_allclose(wall_levels(heights[seen], change[seen]), heights[seen])
    heights[1] = np.nan
    np.testing.assert_allclose(wall_levels(heights, change), [0.5, 1.5, 2.5, 2.5, 1.5, 0.5])


def test_steps_that_are_higher_than_thought_are_told() -> None:
    """Their walls fit any height that theirs is a multiple of."""
    change = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
    heights = np.array([0.5, 1.5, 2.5, 3.5, 3.5, 2.5, 1.5, 0.5])
    for times in (1, 2, 3):
        assert steps_apart(wall_levels(times * heights, change), change) == times
    seen = np.array([0, 2, 3, 5, 6, 7])  # two walls weren't seen
    assert steps_apart(wall_levels(heights[seen], change[seen]), change[seen]) == 1
    for few in (change[:1], change[3:5], change[2:5]):  # one pair says nothing
        assert steps_apart(wall_levels(4 * heights[: len(few)], few), few) == 1
