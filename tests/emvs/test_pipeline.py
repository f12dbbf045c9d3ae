"""The pipeline on analytic scenes: right depth, or none."""

from __future__ import annotations

import numpy as np
import pytest

from emvs.scenes import CAMERA, MS, Motion, events_of, lines, rolling, tilted, track_of, turning
from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import METHODS, DepthSettings
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.windows import RefusedWindow

DURATION_S = 0.12
SETTINGS = DepthSettings.create(
    {
        "window": {"time_s": 0.03, "travel_m": 0.012},
        "paper": {"planes": 80, "threshold_c": 6.0, "median_px": 9, "full_scale_votes": 0.0},
        "focus.sigma_px": 3.0,
    }
)


def reconstruct(
    motion: Motion,
    events: EventArray,
    start_ns: int = 0,
    duration_s: float = DURATION_S,
    **values: object,
) -> list[DepthMap | RefusedWindow]:
    pipeline = DepthPipeline(
        SETTINGS.changed(values), CAMERA, track_of(motion, duration_s, start_ns)
    )
    pipeline.add_events(events)
    return list(pipeline.results(flush=True))


def errors_m(found: DepthMap, offset: float = 0.0) -> np.ndarray:
    """Depth errors against the tilted plane."""
    y, x = np.nonzero(np.isfinite(found.depth))
    z = found.depth[y, x].astype(float)
    base_x = (x - CAMERA.cx) / CAMERA.fx * z + found.pose[0, 3] - offset
    return z - tilted(base_x)


@pytest.fixture(scope="module")
def scan() -> EventArray:
    return events_of(lines(tilted), rolling(0.3), DURATION_S)


@pytest.mark.parametrize("method", METHODS)
def test_a_tilted_plane_is_found(scan: EventArray, method: str) -> None:
    maps = [m for m in reconstruct(rolling(0.3), scan, method=method) if isinstance(m, DepthMap)]
    assert len(maps) >= 3
    errors = np.concatenate([errors_m(m) for m in maps])
    assert len(errors) > 2000
    # One pixel of parallax is 0.28 mm with this camera and travel.
    assert np.median(np.abs(errors)) < (80e-6 if method == "focus" else 200e-6)
    assert abs(np.median(errors)) < (40e-6 if method == "focus" else 150e-6)
    for m in maps:
        measured = m.depth[np.isfinite(m.depth)]
        assert measured.min() >= 0.043 - 1e-6
        assert measured.max() <= 0.047 + 1e-6
        np.testing.assert_array_equal(np.isfinite(m.depth), np.isfinite(m.confidence))
        assert m.stamp_ns == (m.start_ns + m.end_ns) // 2


@pytest.mark.parametrize("method", ["focus", "bma"])
def test_epoch_time_and_a_far_base_change_nothing(scan: EventArray, method: str) -> None:
    epoch = 1_790_000_000_123_456_789
    # Windows by time: a travel reached a nanosecond later would shift an event to the next one.
    near = reconstruct(rolling(0.3), scan, method=method, window={"rule": "time"})
    there = rolling(0.3, (4000.0, -2500.0, 300.0))
    far = reconstruct(there, scan.shifted(epoch), epoch, method=method, window={"rule": "time"})
    assert len(near) == len(far)
    for a, b in zip(near, far, strict=True):
        assert type(a) is type(b)
        if isinstance(a, DepthMap) and isinstance(b, DepthMap):
            same = np.isfinite(a.depth) == np.isfinite(b.depth)
            assert same.mean() > 0.995
            both = np.isfinite(a.depth) & np.isfinite(b.depth)
            apart = np.abs(a.depth - b.depth)[both]
            # Two peaks of nearly the same height may change places; nothing else moves.
            assert np.mean(apart > 2e-5) < 0.02
            assert np.median(apart) < 1e-7


@pytest.mark.parametrize("method", ["focus", "bma"])
def test_results_do_not_depend_on_how_events_arrive(scan: EventArray, method: str) -> None:
    whole = reconstruct(rolling(0.3), scan, method=method)
    settings = SETTINGS.changed({"method": method, "threads": 1})
    pipeline = DepthPipeline(settings, CAMERA, track_of(rolling(0.3), DURATION_S))
    pieces = []
    for k in range(0, len(scan), 997):
        pipeline.add_events(scan[k : k + 997])
        pieces += list(pipeline.results())
    pieces += list(pipeline.results(flush=True))
    assert len(pieces) == len(whole)
    for a, b in zip(whole, pieces, strict=True):
        if isinstance(a, DepthMap):
            np.testing.assert_array_equal(a.depth, b.depth)  # type: ignore[union-attr]


def test_error_does_not_depend_on_speed_with_travel_windows() -> None:
    medians = []
    for speed in (0.1, 0.5):
        duration = 0.03 / speed
        events = events_of(lines(tilted), rolling(speed), duration, step_s=15e-6 / speed)
        maps = reconstruct(rolling(speed), events, duration_s=duration)
        errors = np.concatenate([errors_m(m) for m in maps if isinstance(m, DepthMap)])
        medians.append(float(np.median(np.abs(errors))))
    assert medians[0] < 1.5 * medians[1]


@pytest.mark.parametrize(
    "motion",
    [
        pytest.param(rolling(0.0), id="standstill"),
        pytest.param(turning(0.5), id="pure rotation"),
        pytest.param(
            lambda t: (np.array([0.0, 0.0, 0.2 * t]), np.array([0.0, 0.0, 0.0, 1.0])),
            id="along the optical axis",
        ),
    ],
)
@pytest.mark.parametrize("window", ["travel", "time"])
def test_no_parallax_gives_no_depth(motion: Motion, window: str) -> None:
    rng = np.random.default_rng(0)
    n = 3000
    t = np.sort(rng.integers(0, 100 * MS, n))
    noise = EventArray.from_arrays(
        rng.integers(0, 160, n), rng.integers(0, 120, n), t, rng.integers(0, 2, n)
    )
    found = reconstruct(motion, noise, window={"rule": window, "max_time_s": 0.05})
    assert found
    assert all(isinstance(f, RefusedWindow) for f in found)


@pytest.mark.parametrize("method", METHODS)
def test_odd_streams_do_no_harm(method: str) -> None:
    """One event; a hot pixel; one row; one column; all at one time; none at all."""
    n = 10_000
    t = np.linspace(0, 100 * MS, n).astype(np.int64)
    ones = np.ones(n)
    for events in (
        EventArray.from_arrays([80], [60], [50 * MS], [1]),
        EventArray.from_arrays(80 * ones, 60 * ones, t, ones),
        EventArray.from_arrays(np.arange(n) % 160, 60 * ones, t, ones),
        EventArray.from_arrays(80 * ones, np.arange(n) % 120, t, ones),
        EventArray.from_arrays(np.arange(n) % 160, np.arange(n) % 120, 50 * MS * ones, ones),
        EventArray.empty(),
    ):
        for found in reconstruct(rolling(0.3), events, method=method):
            if isinstance(found, DepthMap):
                measured = found.depth[np.isfinite(found.depth)]
                assert np.all((measured >= 0.0429) & (measured <= 0.0471))


def test_counts_add_up(scan: EventArray) -> None:
    settings = DepthSettings.create({})
    pipeline = DepthPipeline(settings, CAMERA, track_of(rolling(0.3), DURATION_S))
    pipeline.add_events(scan)
    found = list(pipeline.results(flush=True))
    counts = pipeline.counts
    assert counts.windows + counts.refused_windows == len(found)
    assert counts.events + counts.events_without_pose == len(scan)
    assert counts.points == sum(f.points for f in found if isinstance(f, DepthMap))
