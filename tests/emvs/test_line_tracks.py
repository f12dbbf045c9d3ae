"""Lines where events of a wall come in tracks, as pixels are dead for a while after each."""

import numpy as np
import pytest

from roller_emvs.lines import _track_kernels as kernels
from roller_emvs.lines.fit import Lines, fit_lines
from roller_emvs.lines.ray_source import RayArray

PIXEL_M = 4.2e-5
SHAPE = (60, 60)


def tracks(
    seed: int, apart_px: float, noise_px: float, depth_m: float, count: int = 9000
) -> np.ndarray:
    """Rays of two tracks at one depth, the first at column 30 of row 0; px, slopes px by metre."""
    rng = np.random.default_rng(seed)
    slope = rng.uniform(-0.3, 0.3, count) / PIXEL_M
    y = rng.uniform(0, SHAPE[0] - 1, count)
    # Pixels wake up in time for a second event more often the longer they see the wall.
    second = rng.uniform(0, 1, count) < 0.5 + 0.6 * slope * PIXEL_M
    x = 30.0 + 0.05 * y + apart_px * second + rng.normal(0, noise_px, count)
    return np.column_stack([x - slope * depth_m, y, slope, np.zeros(count)]).astype(np.float32)


def lines_of(rays: np.ndarray, direction: float = 1.0) -> Lines:
    surface = np.zeros(SHAPE, np.float32)
    lines = fit_lines(RayArray(rays), surface, (0, SHAPE[1]), 1.0, PIXEL_M, direction)
    assert len(lines) > 20
    return lines


@pytest.mark.parametrize("apart_px", [2.4, -2.4])
def test_a_line_is_of_the_first_track_of_a_wall(apart_px: float) -> None:
    """The camera moves along x, or against it: either way the second track comes later."""
    errors, beside = [], []
    for seed in range(4):
        lines = lines_of(tracks(seed, apart_px, 0.2, 6e-5), np.sign(apart_px))
        errors.extend(lines.offset - 6e-5)
        beside.extend(lines.x - 30.0 - 0.05 * lines.row)
    # Both tracks taken for one band gave another height on every row: 100 µm and more off.
    assert np.mean(np.abs(errors)) < 1.2e-5
    assert np.quantile(np.abs(errors), 0.95) < 3e-5
    assert np.median(np.abs(beside)) < 0.1


def test_a_band_of_one_track_is_fitted_as_a_whole() -> None:
    """What is wide for its noise holds no tracks: all its events count."""
    lines = lines_of(tracks(1, 0.0, 0.8, 6e-5))
    assert np.median(np.abs(lines.x - 30.0 - 0.05 * lines.row)) < 0.1
    assert np.median(lines.band) > 0.6
    # Tukey's weights over the whole window leave more than half of 9000 events in a tenth of a row.
    assert np.median(lines.events) > 0.5 * 9000 * 9.5 / SHAPE[0]


def test_counts_across_a_turned_line_equal_plain_words() -> None:
    rng = np.random.default_rng(3)
    across, slopes = rng.uniform(-4, 30, 300).astype(np.float32), rng.normal(0, 1, 300)
    place, bins = np.empty(300, np.int32), np.empty(25, np.int32)
    for turn in (-2.0, 0.0, 1.5):
        squares = kernels._count_across(across, slopes.astype(np.float32), turn, place, bins)
        at = np.floor(across - np.float32(turn) * slopes.astype(np.float32)).astype(int)
        expected = np.array([np.sum(at == k) for k in range(25)])
        expected[[0, -1]] = 0
        np.testing.assert_array_equal(bins, expected)
        assert squares == np.sum(np.convolve(expected, [1, 2, 1], "valid") ** 2)


@pytest.mark.parametrize("forward", [1.0, -1.0])
@pytest.mark.parametrize("share", [0.45, 0.55])
def test_the_first_track_equals_a_search_in_plain_words(forward: float, share: float) -> None:
    rng = np.random.default_rng(5)
    n, half = 350, 2.9
    slope, y = rng.normal(0.4, 1.0, n), rng.uniform(-4, 4, n)
    where = np.where(rng.uniform(0, 1, n) < share, -1.2, 1.1) + rng.normal(0, 0.15, n)
    events = np.stack([where + 0.3 * slope + 0.1 * y, y, slope]).astype(np.float32)
    line, spread = np.array([0.2, 0.1, 0.1]), 1.0
    per, turns, step = kernels._PER_PX, kernels._TURNS, kernels._TURN_PX / np.sqrt(3 * spread)

    def counts(d: float) -> np.ndarray:
        rest = events[0] - line[2] * events[1] - d * (events[2] - 0.4)
        count = np.histogram(rest, np.arange(-half, half, 1 / per))[0]
        return np.convolve(np.concatenate([[0], count, [0]]), [1, 2, 1], "valid")

    every = [line[1] + turn * step for turn in range(-turns, turns + 1)]
    d = max(every, key=lambda own: np.sum(counts(own) ** 2))
    near = counts(d)
    enough = np.flatnonzero(near >= kernels._FIRST * near.max())
    k = enough[0] if forward > 0 else enough[-1]
    while near[k + int(forward)] > near[k]:
        k += int(forward)
    room = np.empty((2, 2 * kernels._LOOK), np.float32)
    place, bins = np.empty(2 * kernels._LOOK, np.int32), np.empty(int(2 * half * per) + 2, np.int32)
    found = line.copy()
    kernels._first_track(events, n, found, 0.4, half, spread, forward, room, place, bins)
    assert found[0] == pytest.approx((k + 0.5) / per - half, abs=1e-6)
    assert found[1] == pytest.approx(d, abs=1e-9)
    assert found[2] == line[2]
    # What it finds are the tracks that were made.
    assert abs(found[1] - 0.3) < step
    assert abs(found[0] + 1.2 * forward) < 0.4
