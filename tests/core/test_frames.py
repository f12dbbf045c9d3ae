"""What the robot's transforms are taken for, and what is left out."""

import numpy as np
import pytest

from roller_core.frame_transforms import Transform
from roller_core.pose_track import PoseJumpError, PoseOrderError, PoseTrack
from roller_core.sensor_pose import SensorFrames

UP = (0.0, 0.0, 0.0, 1.0)
MS = 1_000_000


@pytest.fixture
def frames() -> SensorFrames:
    made = SensorFrames("base", "tool0_controller", "event_camera_optical_frame", 0.1, 0)
    made.add_static("tool0_controller", "event_camera_optical_frame", (0.0, 0.0, 0.1), UP)
    return made


def put(frames: SensorFrames, t_ms: float, x_m: float) -> bool:
    return frames.add("base", "tool0_controller", round(t_ms * MS), (x_m, 0.0, 0.0), UP)


def test_of_two_mountings_the_newest_holds(frames: SensorFrames) -> None:
    """As in tf2: latched, the one before may come first for ever."""
    put(frames, 0, 0.0)
    frames.add_static("tool0_controller", "event_camera_optical_frame", (5e-3, 0.0, 0.1), UP)
    put(frames, 8, 0.0)
    np.testing.assert_allclose(frames.track.positions, [[0.0, 0.0, 0.1], [5e-3, 0.0, 0.1]])


def test_gaps_are_counted(frames: SensorFrames) -> None:
    for t_ms in (0, 8, 16, 150, 158, 1000):
        put(frames, t_ms, 0.0)
    assert (frames.counts.poses, frames.counts.gaps) == (6, 2)
    assert frames.counts.longest_gap_s == pytest.approx(0.842)


def test_poses_of_two_sources_do_not_mix(frames: SensorFrames) -> None:
    """The second publisher's poses lie half a metre away, between those of the first."""
    told = []
    for k in range(1000):
        put(frames, 8 * k, 1e-3 * k)
        try:
            assert not put(frames, 8 * k + 4, 1e-3 * k + 0.5)
        except PoseJumpError as error:
            told.append(str(error))
    np.testing.assert_allclose(frames.track.positions[:, 0], 1e-3 * np.arange(1000))
    assert frames.counts.jumps == 1000
    assert len(told) == 8  # once a second
    assert "500.0 mm from the one 4.0 ms before it, and left out; do two nodes publish" in told[0]


def test_the_robot_may_be_elsewhere_after_a_pause(frames: SensorFrames) -> None:
    put(frames, 0, 0.0)
    assert put(frames, 600, 1.0)
    assert frames.counts.jumps == 0


def test_a_jump_that_stays_is_believed_once_an_arm_could_be_there(frames: SensorFrames) -> None:
    """As when another TCP is set in the controller."""
    put(frames, 0, 0.0)
    taken = []
    for k in range(1, 100):
        try:
            taken.append(put(frames, 8 * k, 0.2))
        except PoseJumpError:
            taken.append(False)
    assert taken == [False] * 4 + [True] * 95  # 0.2 m at 5 m/s


def test_a_fast_robot_is_none_that_jumps(frames: SensorFrames) -> None:
    for k in range(500):
        assert put(frames, 2 * k, 4.0 * 2e-3 * k)


def test_time_that_runs_backwards_is_told_as_such(frames: SensorFrames) -> None:
    put(frames, 100, 0.0)
    with pytest.raises(PoseOrderError):
        put(frames, 50, 0.5)
    frames.restart()
    assert put(frames, 50, 0.5)


def test_poses_given_at_once_outlast_a_restart(frames: SensorFrames) -> None:
    track = PoseTrack()
    for k in range(10):
        track.append(k * 1_000_000, [k * 1e-3, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    frames.follow(track)
    assert frames.missing() == ""
    assert frames.span_ns == (0, 9_000_000)
    frames.track.discard_before(5_000_000)
    assert len(track) == 10
    frames.restart()
    np.testing.assert_array_equal(frames.track.times_ns, track.times_ns)


def test_poses_given_at_once_are_smoothed_as_those_that_come() -> None:
    rng, jittering, even = np.random.default_rng(3), SensorFrames(), SensorFrames()
    track, stamps = PoseTrack(), np.arange(300) * 8 * MS
    for t_ns, late_ns in zip(stamps, rng.normal(0.0, 2e5, 300).astype(int), strict=True):
        track.append(int(t_ns + late_ns), [t_ns * 0.3e-9, 0.0, 0.0], UP)
    jittering.follow(track)
    apart_ns = jittering.track.times_ns - stamps
    assert len(apart_ns) == 300
    assert apart_ns[20:-20].std() < 0.25 * (track.times_ns - stamps)[20:-20].std()
    exact = PoseTrack()
    exact.extend(stamps, track.positions, track.quaternions)
    even.follow(exact)
    np.testing.assert_array_equal(even.track.times_ns, stamps)


def test_what_is_missing_is_named() -> None:
    fresh = SensorFrames()
    assert fresh.missing() == "no poses base -> tool0_controller on /tf"
    fresh.take(Transform("left_base", "left_tool", 0, (0.0, 0.0, 0.0), UP))
    assert "there is left_base -> left_tool: set base_frame and moving_frame" in fresh.missing()
    fresh.take(Transform("base", "tool0_controller", 0, (0.0, 0.0, 0.0), UP))
    assert fresh.missing() == (
        "no path tool0_controller -> event_camera_optical_frame on /tf_static"
    )
