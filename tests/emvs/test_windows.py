"""Where windows are cut, and that it doesn't matter how the stream arrives."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emvs.scenes import MS, Motion, rolling, track_of
from emvs.window_cutting import cut_all, setting, ticking
from roller_core.dead_time import DeadTime
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_emvs.windows import RefusedWindow, Window, WindowCutter


def test_time_windows_are_20_ms_and_lose_nothing() -> None:
    cutter = WindowCutter(setting(method="bma"), track_of(rolling(0.3), 0.2))
    events = ticking(100)
    cutter.add(events)
    windows = cut_all(cutter)
    assert [w.end_ns - w.start_ns for w in windows[:-1]] == [20 * MS] * 4
    assert sum(len(w.events) for w in windows if isinstance(w, Window)) == len(events)


@pytest.mark.parametrize("speed", [0.05, 0.5])
def test_travel_windows_have_the_same_travel_at_any_speed(speed: float) -> None:
    duration = 0.035 / speed
    track = track_of(rolling(speed), duration)
    cutter = WindowCutter(setting(window={"rule": "travel", "travel_m": 0.005}), track)
    cutter.add(ticking(int(duration * 1000), step_us=1000))
    windows = cut_all(cutter)
    assert len(windows) >= 6
    for w in windows[:6]:
        moved = track.at(w.end_ns).position - track.at(w.start_ns).position
        assert np.linalg.norm(moved) == pytest.approx(0.005, abs=1e-8)


def test_of_a_printed_texture_nothing_is_taken_for_late() -> None:
    """Two events of each pixel, 0.8 ms apart: a dead time, were it not known for a texture."""
    rng = np.random.default_rng(6)
    first = np.sort(rng.integers(0, 90 * MS, 30_000))
    x, y = rng.integers(0, 64, len(first)), rng.integers(0, 48, len(first))
    t = np.concatenate([first, first + MS * 4 // 5])
    events = EventArray.from_arrays(*np.tile([x, y], 2), t, np.ones(len(t))).sorted_by_time()
    for textured in (False, True):
        cutter = WindowCutter(setting(method="bma"), track_of(rolling(0.5), 0.2))
        cutter.dead_time, cutter.textured = DeadTime(64, 48), textured
        cutter.dead_time.blind_m = 4e-4
        cutter.add(events)
        cut_all(cutter)
        assert cutter.dead_time.known != textured
        assert (cutter.dead_time.left_out == 0) or not textured
        assert cutter.dead_time.blind_m == 0.0 or not textured


@settings(max_examples=30)
@given(
    cuts=st.lists(st.integers(1, 999), max_size=12),
    rule=st.sampled_from(["time", "travel"]),
    overlap=st.sampled_from([0.0, 0.5]),
    turn_s=st.sampled_from([1.0, 0.041, 0.052]),
)
def test_arrival_does_not_matter(cuts: list[int], rule: str, overlap: float, turn_s: float) -> None:
    s = setting(window={"rule": rule, "travel_m": 0.005, "overlap": overlap})
    events = ticking(100)
    whole = WindowCutter(s, track_of(turning(turn_s), 0.15))
    whole.add(events)
    expected = [(w.start_ns, w.end_ns) for w in cut_all(whole)]

    poses = track_of(turning(turn_s), 0.15)
    track = PoseTrack()
    live, found, k = WindowCutter(s, track), [], 0
    bounds = [0, *sorted(set(cuts)), len(events)]
    for a, b in pairwise(bounds):
        live.add(events[a:b])
        # Poses arrive a little later than events.
        while k < len(poses) and poses.times_ns[k] < events.t_ns[b - 1] - 5 * MS:
            track.append(int(poses.times_ns[k]), poses.positions[k], poses.quaternions[k])
            k += 1
        found += cut_all(live, flush=False)
        if live.needed_from_ns is not None:
            track.discard_before(live.needed_from_ns)
    for j in range(k, len(poses)):
        track.append(int(poses.times_ns[j]), poses.positions[j], poses.quaternions[j])
    found += cut_all(live)
    assert [(w.start_ns, w.end_ns) for w in found] == expected


def test_the_end_by_travel_is_looked_for_with_each_pose_and_not_with_each_packet(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, look = [], WindowCutter._travel_end

    def travel_end(cutter: WindowCutter, start: int, last: int) -> object:
        found.append(start)
        return look(cutter, start, last)

    monkeypatch.setattr(WindowCutter, "_travel_end", travel_end)
    poses, track, events = track_of(rolling(0.3), 0.1), PoseTrack(), ticking(100)
    cutter, windows = WindowCutter(setting(window={"rule": "travel", "travel_m": 0.02}), track), []
    for packet in np.array_split(np.arange(len(events)), 200):
        now_ns = events.t_ns[packet[-1]]
        for k in range(len(track), int(np.searchsorted(poses.times_ns, now_ns, side="right"))):
            track.append(int(poses.times_ns[k]), poses.positions[k], poses.quaternions[k])
        cutter.add(events[packet])
        windows += cut_all(cutter, flush=False)
    assert len(windows) == 1
    assert len(found) <= len(track) + len(windows)


def test_a_window_waits_for_its_poses() -> None:
    track = track_of(rolling(0.3), 0.008)
    cutter = WindowCutter(setting(method="bma"), track)
    cutter.add(ticking(50))
    end = track.end_ns
    assert cutter.cut() is None or end >= 20 * MS
    for k in range(1, 4):
        track.append(end + k * 8 * MS, [0.0, 0.0, 0.0], [0, 0, 0, 1])
    assert isinstance(cutter.cut(), Window)


def test_standstill_is_refused() -> None:
    cutter = WindowCutter(setting(max_still_s=0.05), track_of(rolling(0.0), 0.3))
    cutter.add(ticking(200))
    windows = cut_all(cutter)
    assert windows
    assert all(isinstance(w, RefusedWindow) for w in windows)
    assert "no parallax" in windows[0].reason  # type: ignore[union-attr]


def turning(turn_s: float) -> Motion:
    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        x = 0.3 * min(t, 2 * turn_s - t)
        return np.array([x, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])

    return motion


def test_a_window_ends_where_the_sensor_turns_back() -> None:
    """After 4.8 mm of 5; both ways together would show walls where events come late by either."""
    track = track_of(turning(0.016), 0.1)
    cutter = WindowCutter(setting(window={"travel_m": 0.005}), track)
    cutter.add(ticking(100))
    first, second = cutter.cut(True), cutter.cut(True)
    assert isinstance(first, Window)
    assert isinstance(second, Window)
    assert first.end_ns == second.start_ns == 16 * MS
    moved = track.at(second.end_ns).position - track.at(second.start_ns).position
    assert moved[0] == pytest.approx(-0.005, abs=1e-7)


def test_a_way_too_short_for_a_window_counts_to_the_one_back() -> None:
    """2.4 mm of 10: the distance from the start is what counts."""
    track = track_of(turning(0.008), 0.1)
    cutter = WindowCutter(setting(window={"travel_m": 0.01}), track)
    cutter.add(ticking(100))
    first = cutter.cut(True)
    assert isinstance(first, Window)
    moved = track.at(first.end_ns).position - track.at(first.start_ns).position
    assert np.linalg.norm(moved) == pytest.approx(0.01, abs=1e-7)
    assert first.end_ns > 48 * MS


@pytest.mark.parametrize("rule", ["time", "travel"])
def test_a_gap_in_the_poses_costs_only_its_windows(rule: str) -> None:
    track = PoseTrack(max_gap_s=0.05)
    for k in range(60):
        if not 15 <= k < 30:
            track.append(k * 8 * MS, [0.0024 * k, 0, 0], [0, 0, 0, 1])
    cutter = WindowCutter(setting(window={"rule": rule, "travel_m": 0.006}), track)
    cutter.add(ticking(450))
    windows = cut_all(cutter)
    refused = [w for w in windows if isinstance(w, RefusedWindow)]
    assert any("gap" in w.reason for w in refused)
    good = [w for w in windows if isinstance(w, Window)]
    assert min(w.start_ns for w in good) < 40 * MS
    assert max(w.end_ns for w in good) > 400 * MS
    for w in good:
        track.check(w.start_ns, w.end_ns)


def test_events_of_a_hard_ramp_are_left_out_and_counted_however_they_arrive() -> None:
    # From 0.3 m/s to rest at 15 m/s² in 20 ms, after 100 ms.
    t = np.arange(0, 201, 8) * MS
    s = np.clip(t * 1e-9 - 0.1, 0, 0.02)
    x = 0.3 * np.minimum(t * 1e-9, 0.1) + 0.3 * s - 7.5 * s**2

    def cutter_of(track: PoseTrack) -> WindowCutter:
        cutter = WindowCutter(setting(method="bma"), track)
        cutter.most_bend_m = 40e-6
        return cutter

    whole = PoseTrack()
    whole.extend(t, np.stack([x, 0 * x, 0 * x], 1), np.tile([0.0, 0, 0, 1], (len(t), 1)))
    cutter = cutter_of(whole)
    events = ticking(200)
    cutter.add(events)
    windows = [w for w in cut_all(cutter) if isinstance(w, Window)]
    kept = np.concatenate([w.events.t_ns for w in windows])
    assert len(kept) + cutter.ramp_events == len(events)
    lost = np.setdiff1d(events.t_ns, kept)
    assert lost.min() >= 96 * MS
    assert lost.max() < 128 * MS
    assert np.isin(np.arange(104, 120) * MS, lost).all()

    track = PoseTrack()
    live = cutter_of(track)
    live.add(events)
    pieces = []
    for k in range(len(t)):
        track.append(int(t[k]), [x[k], 0, 0], [0, 0, 0, 1])
        pieces += cut_all(live, flush=k == len(t) - 1)
    got = np.concatenate([w.events.t_ns for w in pieces if isinstance(w, Window)])
    np.testing.assert_array_equal(got, kept)


def test_events_without_poses_are_counted() -> None:
    track = PoseTrack()
    for k in range(10):
        track.append((50 + k * 8) * MS, [0.0024 * k, 0, 0], [0, 0, 0, 1])
    cutter = WindowCutter(setting(method="bma"), track)
    cutter.add(ticking(200))
    cut_all(cutter)
    assert cutter.events_without_pose >= 500


def test_quiet_times_are_skipped() -> None:
    cutter = WindowCutter(setting(method="bma"), track_of(rolling(0.1), 2.1))
    cutter.add(ticking(20))
    cutter.add(ticking(40, start_ns=2000 * MS))
    windows = cut_all(cutter)
    assert len(windows) <= 4
    assert windows[-1].start_ns >= 1980 * MS


def test_the_backlog_is_bounded_and_counted() -> None:
    cutter = WindowCutter(setting(max_waiting_mb=0.16), PoseTrack())
    for k in range(30):
        cutter.add(ticking(100, start_ns=k * 100 * MS))
    assert cutter.held_events <= 10_000
    assert cutter.dropped_events == 20_000


def test_all_of_a_recording_is_one_window() -> None:
    cutter = WindowCutter(setting(window={"rule": "all"}), track_of(rolling(0.1), 0.5))
    cutter.add(ticking(400))
    assert cutter.cut() is None
    window = cutter.cut(flush=True)
    assert isinstance(window, Window)
    assert len(window.events) == 4000
    assert cutter.cut(flush=True) is None


def test_a_short_tail_is_refused() -> None:
    cutter = WindowCutter(setting(method="bma"), track_of(rolling(0.3), 0.1))
    cutter.add(ticking(25))
    windows = cut_all(cutter)
    assert isinstance(windows[0], Window)
    assert isinstance(windows[-1], RefusedWindow)
    assert "too short" in windows[-1].reason


def until_rest(t: float) -> tuple[np.ndarray, np.ndarray]:
    """0.3 m/s for 50 ms, then at rest, shaken by 20 µm."""
    x = 0.3 * min(t, 0.05) + 2e-5 * np.sin(400 * t)
    return np.array([x, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])


def test_the_last_window_comes_when_the_sensor_rests_though_noise_goes_on() -> None:
    poses, track, events = track_of(until_rest, 5.0), PoseTrack(), ticking(5000)
    cutter, found = WindowCutter(setting(), track), []
    for k in range(len(poses)):
        now_ns = int(poses.times_ns[k])
        track.append(now_ns, poses.positions[k], poses.quaternions[k])
        a, b = np.searchsorted(events.t_ns, [now_ns - 8 * MS, now_ns])
        cutter.add(events[a:b])
        for window in cut_all(cutter, flush=False):
            found.append((window, now_ns, cutter.at_rest))
    ((window, came_ns, at_rest),) = found
    assert isinstance(window, Window)
    assert at_rest
    assert window.end_ns == pytest.approx(50 * MS, abs=8 * MS)
    assert came_ns - window.end_ns < 250 * MS
    assert cut_all(cutter) == []
    assert len(window.events) + cutter.still_events == len(events[events.t_ns < now_ns])
    # A replay has all poses at once, and cuts no other way.
    whole = WindowCutter(setting(), poses)
    whole.add(events)
    first = whole.cut()
    assert first is not None
    assert (first.start_ns, first.end_ns) == (window.start_ns, window.end_ns)


def test_a_rest_after_too_short_a_way_ends_no_window() -> None:
    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        x = 0.3 * (min(t, 0.02) + max(t - 0.5, 0.0))
        return np.array([x, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])

    track = track_of(motion, 1.0)
    cutter = WindowCutter(setting(), track)
    cutter.add(ticking(1000))
    window = cutter.cut()
    assert isinstance(window, Window)
    assert not cutter.at_rest
    assert np.linalg.norm(track.at(window.end_ns).position) == pytest.approx(0.028, abs=1e-7)
