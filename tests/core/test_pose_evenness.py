"""Stamps of poses that scatter too much for depth are told from what a robot does."""

import numpy as np
import pytest

from roller_core.pose_evenness import StampWatch, UnevenStampsError
from roller_core.pose_track import PoseTrack

PERIOD_S, SPEED = 8e-3, 0.3


def track_of(
    way_m: np.ndarray, jitter_s: float = 0.0, noise_m: float = 0.0, keep: np.ndarray | None = None
) -> PoseTrack:
    """Poses along x at a steady rate, their stamps off by jitter."""
    rng = np.random.default_rng(1)
    t = np.arange(len(way_m)) * PERIOD_S
    stamps = np.sort(t + rng.normal(0.0, jitter_s, len(t)))
    places = np.zeros((len(t), 3))
    places[:, 0] = way_m + rng.normal(0.0, noise_m, len(t))
    kept = np.ones(len(t), bool) if keep is None else keep
    track = PoseTrack()
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))
    ns = 10**18 + np.round(stamps * 1e9).astype(np.int64)
    track.extend(ns[kept], places[kept], turns[kept])
    return track


T = np.arange(80) * PERIOD_S
STEADY = SPEED * T
RAMP = np.where(T < 0.3, 0.5 * 2.0 * T**2, 0.09 + 0.6 * (T - 0.3))
SHAKEN = STEADY + 1e-4 * np.sin(2 * np.pi * 50.0 * T)


def refusals(track: PoseTrack, span_s: float) -> int:
    """How many of the spans, one after the other, are refused."""
    watch, found = StampWatch(), 0
    for start in np.arange(track.start_ns, track.end_ns - round(span_s * 1e9), round(span_s * 5e8)):
        try:
            watch.check(track, int(start), int(start) + round(span_s * 1e9))
        except UnevenStampsError:
            found += 1
    return found


@pytest.mark.parametrize("span_s", [0.02, 0.09, 0.3])
@pytest.mark.parametrize(
    "track",
    [
        track_of(STEADY),
        track_of(STEADY, jitter_s=5e-5, noise_m=2e-5),
        track_of(RAMP),
        track_of(SHAKEN),
        track_of(np.where(T < 0.3, STEADY, 0.09)),  # comes to rest at once
        track_of(SPEED * np.minimum(T, 0.6 - T)),  # to and fro
        track_of(STEADY, keep=np.random.default_rng(3).random(80) > 0.3),  # some never came
        track_of(SPEED / 20 * T, jitter_s=1e-3),  # so slow that it doesn't matter
    ],
)
def test_what_a_robot_does_is_no_fault_of_stamps(track: PoseTrack, span_s: float) -> None:
    assert refusals(track, span_s) == 0


@pytest.mark.parametrize("span_s", [0.02, 0.09, 0.3])
@pytest.mark.parametrize("path", [STEADY, RAMP])
def test_stamps_that_scatter_are_refused(path: np.ndarray, span_s: float) -> None:
    spans = refusals(track_of(path, jitter_s=0.0), span_s)
    assert spans == 0
    found = refusals(track_of(path, jitter_s=1.2e-3), span_s)
    assert found >= 0.6 * (0.63 - span_s) / (0.5 * span_s) - 6


def test_it_says_by_how_much_and_needs_some_poses() -> None:
    track = track_of(STEADY, jitter_s=1e-3)
    times = track.times_ns
    with pytest.raises(UnevenStampsError) as caught:
        StampWatch().check(track, int(times[0]), int(times[-1]))
    scatter_ms = float(str(caught.value).split("some ")[1].split(" ms")[0])
    assert 0.6 < scatter_ms < 1.6
    StampWatch().check(track, int(times[0]), int(times[8]))
