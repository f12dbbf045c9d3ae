import numpy as np
import pytest

from roller_core.pose_track import PoseTrack
from roller_core.transforms import quaternion_to_matrix
from roller_sim.cell_settings import MotionSettings
from roller_sim.errors import VirtualCellError
from roller_sim.motion import CAMERA_DOWN, Path, PoseStream, hand_eye
from sim import virtual_twins as twins


def path(**values):
    values = {"start_mm": -2.0, "end_mm": 18.0, "vibration_um": 0.0} | values
    return Path(MotionSettings.create(values), 0.045, 3)


def test_ramps_lie_outside_the_stretch_at_full_speed():
    p = path(speed=0.4, acceleration=10.0, hold_s=0.05)
    begin, end = p.even_s
    assert p.along(begin) == pytest.approx(-2e-3)
    assert p.along(end) == pytest.approx(18e-3)
    assert p.along(0.0) == pytest.approx(-2e-3 - 0.4**2 / 20)
    t = np.linspace(begin, end, 50)
    np.testing.assert_allclose(p.speed(t), 0.4)
    assert p.speed(0.02) == 0.0
    assert p.duration_s == pytest.approx(0.1 + 2 * 0.04 + 0.02 / 0.4)


def test_speed_is_the_derivative_of_place():
    p = path(reverse=True)
    t = np.linspace(1e-4, p.duration_s - 1e-4, 3001)
    slope = (p.along(t + 1e-6) - p.along(t - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope, p.speed(t), atol=2e-4)
    assert p.speed(t).min() == pytest.approx(-0.3)
    assert p.along(p.duration_s) == pytest.approx(float(p.along(0.0)))


def test_a_scan_may_go_backwards():
    p = path(start_mm=18.0, end_mm=-2.0)
    assert p.speed(sum(p.even_s) / 2) == pytest.approx(-0.3)
    assert p.along(p.even_s[0]) == pytest.approx(18e-3)
    with pytest.raises(VirtualCellError, match="start and an end that differ"):
        path(start_mm=1.0, end_mm=1.0)


def test_frames_are_close_in_place_and_time():
    p = path(hold_s=0.03)
    t = p.frame_times(20e-6, 1e-3)
    assert t[0] == 0.0
    assert t[-1] >= p.duration_s
    assert np.diff(t).max() <= 1.01e-3
    assert np.abs(np.diff(p.along(t))).max() <= 20.5e-6
    assert len(t) < 1.2 * (0.026 / 20e-6 + p.duration_s / 1e-3)


def test_vibration_has_the_strength_set():
    p = path(vibration_um=5.0, hold_s=2.0)
    t = np.linspace(0, 2.0, 4001)
    off = p.over_plate(t) - np.stack([p.along(t), 0 * t, 0 * t + 0.045], axis=1)
    np.testing.assert_allclose(off.std(axis=0), 5e-6, rtol=0.25)


def test_poses_lead_back_to_the_camera():
    settings = twins.small("flat", clock={"pose_noise_um": 0.0, "pose_jitter_us": 0.0},
                           motion={"plate_origin_m": [0.4, -0.1, 0.02]})  # fmt: skip
    p = Path(
        settings.motion.model_copy(update={"start_mm": 0.0, "end_mm": 9.0}), 0.045, settings.seed
    )
    poses = PoseStream.record(p, settings.clock, settings.seed)
    fixed = hand_eye()
    assert not np.allclose(fixed[:3, :3], np.eye(3), atol=0.1)
    seconds = (poses.stamp_ns - 1_700_000_000_000_000_000) * 1e-9
    true = p.in_base(seconds)
    for position, quaternion, want in zip(poses.position, poses.quaternion, true, strict=True):
        rotation = quaternion_to_matrix(quaternion)
        np.testing.assert_allclose(position + rotation @ fixed[:3, 3], want, atol=1e-9)
        np.testing.assert_allclose(rotation @ fixed[:3, :3], CAMERA_DOWN, atol=1e-9)
    np.testing.assert_allclose(np.diff(seconds), 0.008, atol=1e-9)
    assert seconds[-1] > p.duration_s
    track = PoseTrack()
    track.extend(poses.stamp_ns, poses.position, poses.quaternion)
    assert track.covers(int(poses.stamp_ns[0]), int(poses.stamp_ns[-1]))


def test_pose_clock_has_the_offset_and_jitter_set():
    settings = twins.small("flat", clock={"pose_offset_us": 500.0, "pose_jitter_us": 100.0},
                           motion={"start_mm": 0.0, "end_mm": 9.0, "hold_s": 3.0})  # fmt: skip
    p = Path(settings.motion, 0.045, 1)
    poses = PoseStream.record(p, settings.clock, 1)
    true = 0.3 * 0.008 + 0.008 * np.arange(len(poses.stamp_ns))
    error = (poses.stamp_ns - 1_700_000_000_000_000_000) * 1e-9 - true
    assert error.mean() == pytest.approx(500e-6, abs=20e-6)
    assert error.std() == pytest.approx(100e-6, rel=0.2)
    assert (np.diff(poses.stamp_ns) >= 0).all()
    assert (poses.arrival_ns > poses.stamp_ns - 1_000_000).all()
