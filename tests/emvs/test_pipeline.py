"""The pipeline on analytic scenes: right depth, or none."""

import numpy as np
import pytest

from emvs.scenes import (
    CAMERA,
    MS,
    Motion,
    events_of,
    lines,
    rolling,
    tilted,
    tilted_scan,
    track_of,
    waking,
)
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
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
    return tilted_scan(DURATION_S)


def test_a_range_in_millimetres_shows_in_the_reason(scan: EventArray) -> None:
    found = reconstruct(rolling(0.3), scan, depth_min_m=43.0, depth_max_m=47.0)
    assert isinstance(found[0], RefusedWindow)
    assert "over depths of 43 to 47 m is below 2 px" in found[0].reason


def test_focus_leaves_out_what_pixels_tell_when_they_wake_up(scan: EventArray) -> None:
    events, edges = waking(scan, MS), np.unique(lines(tilted)[:, 0])
    for method, least, most in (("focus", 0.95, 1.0), ("bma", 0.0, 0.8)):
        found = reconstruct(rolling(0.3), events, method=method)[1]
        assert isinstance(found, DepthMap)
        y, x = np.nonzero(np.isfinite(found.depth))
        z = found.depth[y, x]
        place = (x - CAMERA.cx) / CAMERA.fx * z + found.pose[0, 3]
        on_edges = np.mean(np.abs(place[:, None] - edges).min(axis=1) < 1e-4)
        assert least < on_edges <= most


def test_few_events_that_share_a_pose_are_as_sharp_as_many(scan: EventArray) -> None:
    """Of few events, so many as share a pose come from pixels apart, and depth is no worse."""
    few = scan[::20]
    off_um = [
        1e6 * np.median([np.abs(errors_m(m)).mean() for m in maps if isinstance(m, DepthMap)])
        for maps in (reconstruct(rolling(0.3), few, packet_events=size) for size in (8, 1024))
    ]
    assert off_um[1] < 1.1 * off_um[0]


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


def test_error_does_not_depend_on_speed_with_travel_windows() -> None:
    medians = []
    for speed in (0.1, 0.5):
        duration = 0.03 / speed
        events = events_of(lines(tilted), rolling(speed), duration, step_s=15e-6 / speed)
        maps = reconstruct(rolling(speed), events, duration_s=duration)
        errors = np.concatenate([errors_m(m) for m in maps if isinstance(m, DepthMap)])
        medians.append(float(np.median(np.abs(errors))))
    assert medians[0] < 1.5 * medians[1]


@pytest.mark.parametrize("begin_s", [0.0, 0.05])
def test_counts_add_up_where_windows_overlap_and_poses_are_missing(begin_s: float) -> None:
    """The robot accelerates at 20 m/s², which poses 8 ms apart don't tell."""

    def starting(t: float) -> tuple[np.ndarray, np.ndarray]:
        first, since = (0.2, t - begin_s) if begin_s else (0.0, t)
        way = first * t + 10.0 * min(max(since, 0.0), 0.02) ** 2 + 0.4 * max(since - 0.02, 0.0)
        return np.array([way, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])

    events = events_of(lines(tilted), starting, 0.16)
    for missing in (False, True):
        whole, track = track_of(starting, 0.16), PoseTrack(max_gap_s=0.03)
        for t, p, q in zip(whole.times_ns, whole.positions, whole.quaternions, strict=True):
            if not (missing and 60e6 < t - whole.start_ns < 110e6):
                track.append(int(t), p, q)
        pipeline = DepthPipeline(DepthSettings.create({"window.overlap": 0.5}), CAMERA, track)
        pipeline.add_events(events)
        list(pipeline.results(flush=True))
        c = pipeline.counts
        assert c.ramp_events > 0
        told = c.events + c.events_without_pose + c.ramp_events + c.still_events + c.dropped_events
        assert told + c.dead_time_events == len(events)


def test_counts_add_up(scan: EventArray) -> None:
    settings = DepthSettings.create({})
    pipeline = DepthPipeline(settings, CAMERA, track_of(rolling(0.3), DURATION_S))
    pipeline.add_events(scan)
    found = list(pipeline.results(flush=True))
    counts = pipeline.counts
    assert counts.windows + counts.refused_windows == len(found)
    assert counts.events + counts.events_without_pose == len(scan)
    assert counts.points == sum(f.points for f in found if isinstance(f, DepthMap))
