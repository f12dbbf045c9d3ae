"""Smoothed pose stamps: less jitter at a steady rate, nothing changed elsewhere."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.stamp_twin import off
from roller_core import _stamp_kernels as kernels
from roller_core.pose_smoothing import StampSmoother
from roller_core.pose_track import PoseOrderError
from roller_core.sensor_pose import SensorFrames

EPOCH_NS = 1_790_000_000_000_000_000
JITTER_NS = 30_000


def smoothed(stamps: list[int], neighbours: int) -> list[int]:
    smoother: StampSmoother[int] = StampSmoother(neighbours)
    out = [pair for k, t in enumerate(stamps) for pair in smoother.push(t, k)]
    out += smoother.finish()
    assert [item for _, item in out] == list(range(len(stamps)))
    return [t for t, _ in out]


def jittery(count: int = 1000, period_ns: int = 8_000_000) -> tuple[np.ndarray, np.ndarray]:
    """True stamps of a steady rate, and the same with 30 µs of jitter."""
    true = EPOCH_NS + np.arange(count) * period_ns
    noise = np.random.default_rng(0).normal(0, JITTER_NS, count)
    return true, true + np.rint(noise).astype(np.int64)


def test_jitter_falls_to_a_quarter_and_less_between_poses_of_an_aperture() -> None:
    true, noisy = jittery()
    left = (np.array(smoothed(noisy.tolist(), 4)) - true)[20:-20]
    assert left.std() < 0.25 * JITTER_NS
    # Depth is travel over parallax: what counts is the time between poses, here 56 ms apart.
    assert (left[7:] - left[:-7]).std() < 0.18 * JITTER_NS


def test_the_newest_stamps_alone_count_however_long_it_goes_on() -> None:
    _, noisy = jittery(3000)
    whole = smoothed(noisy.tolist(), 4)
    for begin in range(0, 2200, 300):
        part = smoothed(noisy[begin : begin + 800].tolist(), 4)
        assert part[300:-10] == whole[begin + 300 : begin + 790]


@pytest.mark.parametrize("seed", range(6))
def test_loops_over_stamps_equal_their_numpy_twin(seed: int) -> None:
    """Steady, late, missing and uneven ones, by hundreds and by a few; some wander."""
    random, found = np.random.default_rng(seed), 0
    for count in (*range(1, 12), *[30, 80, 261] * 8):
        for jitter in (0.0, 0.004, 0.03, 0.3):
            period = random.choice([2_000_000, 8_000_000, 33_333_333])
            steps = 1 + (random.random(count) < 0.03) * random.integers(1, 14, count)
            wander = random.choice([0.0, 0.01]) * np.sin(np.arange(count) / 12)
            noise = wander + jitter * random.normal(size=count)
            stamps = EPOCH_NS + (np.cumsum(steps) + noise) * period
            stamps[random.random(count) < 0.02] += 0.4 * period
            own = int(random.integers(max(0, count - 5), count))
            stamps[max(own - 4, 0) : own + 5] += random.normal() * jitter * period
            stamps = np.maximum.accumulate(stamps.astype(np.int64))
            got = kernels._off(stamps, own, 4, kernels.stamp_buffers(count))
            want = off((stamps - stamps[own]).astype(np.float64), own, 4)
            assert got == pytest.approx(want, abs=0.01)
            found += want != 0
    assert found > 15


def test_late_and_missing_ones_spoil_no_others() -> None:
    true, noisy = jittery()
    rng = np.random.default_rng(1)
    late = rng.choice(1000, 20, replace=False)
    noisy[late] += rng.integers(500_000, 3_500_000, 20)
    kept = rng.random(1000) > 0.1
    left = np.array(smoothed(noisy[kept].tolist(), 4)) - true[kept]
    others = ~np.isin(np.arange(1000), late)[kept]
    others[:20] = False
    assert left[others].std() < 0.35 * JITTER_NS


def test_a_rate_that_wanders_is_followed() -> None:
    true, noisy = jittery()
    wander = np.rint(300_000 * np.sin(np.arange(1000) / 40)).astype(np.int64)
    left = np.array(smoothed((noisy + wander).tolist(), 4)) - true - wander
    assert left[20:-20].std() < 0.6 * JITTER_NS
    assert np.abs(left).max() < 5 * JITTER_NS


def test_stamps_at_random_are_hardly_moved() -> None:
    steps = np.random.default_rng(2).exponential(8e6, 1000)
    stamps = EPOCH_NS + np.cumsum(steps).astype(np.int64)
    moved = np.array(smoothed(stamps.tolist(), 4)) - stamps
    assert (moved != 0).mean() < 0.1


def wander_um(period_ns: float, count: int, seed: int) -> float:
    """What stamps put on depths: their drift within 60 ms, of a surface 45 mm away, µm RMS."""
    true = EPOCH_NS + np.rint(np.arange(count) * period_ns).astype(np.int64)
    noise = np.random.default_rng(seed).normal(0, JITTER_NS, count)
    left = np.array(smoothed((true + np.rint(noise)).astype(np.int64).tolist(), 8)) - true
    size = round(60e6 / period_ns)
    place = np.arange(size) - 0.5 * (size - 1)
    drift = [(left[k : k + size] @ place) / (place @ place) for k in range(10, count - size)]
    return float(np.sqrt(np.mean(np.square(drift)))) / period_ns * 45e3


@pytest.mark.parametrize("off_ppm", [-20.0, 0.0, 50.0])
@pytest.mark.parametrize("period_ns", [8e6, 2e6])
def test_a_short_scan_leans_on_the_clock_of_the_controller(
    period_ns: float, off_ppm: float
) -> None:
    """Whole milliseconds but for some crystal: so few stamps tell the rate less well."""
    count = round(0.4e9 / period_ns)
    period_ns *= 1 + off_ppm * 1e-6
    assert np.median([wander_um(period_ns, count, seed) for seed in range(12)]) < 3.4


def test_a_rate_of_no_whole_milliseconds_is_its_own() -> None:
    """Nor is one whose clock is a per mille off: what is told stays as sure as elsewhere."""
    for period_ns in (1e9 / 120, 8.008e6):
        found = np.median([wander_um(period_ns, 60, seed) for seed in range(12)])
        assert found < 5.5


@given(steps=st.lists(st.integers(1, 10**9), max_size=40), neighbours=st.integers(0, 6))
def test_order_stays_and_no_item_is_lost(steps: list[int], neighbours: int) -> None:
    stamps = (EPOCH_NS + np.cumsum(steps)).tolist() if steps else []
    out = smoothed(stamps, neighbours)
    assert all(b > a for a, b in pairwise(out))


def test_a_steady_rate_and_an_uneven_one_are_left_alone() -> None:
    steady = [EPOCH_NS + k * 8_000_000 for k in range(30)]
    assert smoothed(steady, 4) == steady
    uneven = (EPOCH_NS + np.cumsum(np.tile([2_000_000, 20_000_000], 15))).tolist()
    assert smoothed(uneven, 4) == uneven


def test_a_gap_is_not_smeared() -> None:
    stamps = [EPOCH_NS + k * 8_000_000 + (300_000_000 if k >= 10 else 0) for k in range(20)]
    assert smoothed(stamps, 4) == stamps


def test_time_running_backwards_is_refused() -> None:
    smoother: StampSmoother[int] = StampSmoother(2)
    smoother.push(EPOCH_NS, 0)
    with pytest.raises(PoseOrderError) as caught:
        smoother.push(EPOCH_NS - 2_000_000_000, 1)
    assert caught.value.behind_s == pytest.approx(2.0)


def test_frames_wait_for_neighbours_and_let_go_at_the_end() -> None:
    frames = SensorFrames(moving="tool", sensor="camera", smoothing=3)
    for k in range(10):
        frames.add("base", "tool", k * 8_000_000, (0.001 * k, 0, 0), (0, 0, 0, 1))
    assert len(frames.track) == 0
    # The way to the camera may come late.
    frames.add_static("mount", "tool", (0, 0, -0.1), (0, 0, 0, 1))
    frames.add_static("mount", "camera", (0, 0, 0.2), (0, 0, 0, 1))
    assert len(frames.track) == 7
    frames.finish()
    assert len(frames.track) == 10
    np.testing.assert_allclose(frames.track.positions[5], [0.005, 0, 0.3])
    frames.restart()
    assert len(frames.track) == 0
    assert frames.hand_eye is not None


def test_other_transforms_are_passed_over() -> None:
    frames = SensorFrames()
    assert not frames.add("base", "elbow", 0, (0, 0, 0), (0, 0, 0, 1))
    assert not frames.has_robot_poses


@pytest.mark.parametrize("neighbours", [0, 1, 4])
def test_an_older_one_is_refused_and_changes_nothing(neighbours: int) -> None:
    smoother: StampSmoother[int] = StampSmoother(neighbours)
    out = [p for k in range(20) for p in smoother.push(8 * k, k)]
    with pytest.raises(PoseOrderError):
        smoother.push(150, 99)
    out += smoother.push(160, 20)
    out += smoother.finish()
    assert [item for _, item in out] == list(range(21))
