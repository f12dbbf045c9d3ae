"""The camera's place on the tool, from pairs of poses and from a scan."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from calibration.scans import ROLLING
from driver.emulation.controller_process import ControllerProcess
from emvs.scenes import events_of, track_of
from own import LOOPBACK
from recording.bags import HAND_EYE_POSITION, HAND_EYE_ROTATION, Recipe, write_bag
from roller_bringup.cli import main
from roller_calibration import camera_rotation, flat_pass
from roller_calibration.camera_rotation import (
    CameraRotation,
    CameraRotationError,
    find_camera_rotation,
)
from roller_calibration.hand_eye import HandEyeError, find_hand_eye
from roller_calibration.recordings import Scan, read_scan
from roller_core.calibration_file import (
    SECTION,
    CalibrationError,
    calibration_record,
    write_calibration,
)
from roller_core.parameter_files import read_parameters
from roller_core.pose_track import PoseTrack
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import inverse_pose, pose_matrix, rotation_vector_to_quaternion
from roller_driver.ur10.robot_settings import Ur10Parameters
from roller_recording.reading import open_recording

HAND_EYE = pose_matrix([0.02, -0.013, 0.11], rotation_vector_to_quaternion([0.1, -0.2, 1.3]))
TURN_DEG = np.array([0.0, 0.5, -1.1])


def pairs(
    count: int, about: np.ndarray, noise_m: float = 0.0, noise_rad: float = 0.0
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Tool in base and target in camera; `about` scales the turns about x, y and z."""
    rng = np.random.default_rng(7)
    target = pose_matrix([0.5, 0.1, 0.0], rotation_vector_to_quaternion([3.1, 0.1, 0.0]))
    tools, targets = [], []
    for _ in range(count):
        turn = Rotation.from_rotvec(about * rng.uniform(-0.5, 0.5, 3))
        turned = Rotation.from_rotvec([3.0, 0.2, 0.0]) * turn
        tool = pose_matrix(rng.normal([0.5, 0.1, 0.3], 0.05), turned.as_quat())
        off = pose_matrix(
            rng.normal(0, noise_m, 3), Rotation.from_rotvec(rng.normal(0, noise_rad, 3)).as_quat()
        )
        tools.append(tool)
        targets.append(inverse_pose(tool @ HAND_EYE) @ target @ off)
    return tools, targets


def test_hand_eye_is_found_with_its_residuals() -> None:
    exact = find_hand_eye(*pairs(6, np.ones(3)))
    np.testing.assert_allclose(exact.pose, HAND_EYE, atol=1e-7)
    noisy = find_hand_eye(*pairs(20, np.ones(3), 1e-4, 1e-3))
    assert np.linalg.norm(noisy.pose[:3, 3] - HAND_EYE[:3, 3]) < 3e-4
    assert noisy.rms_m == pytest.approx(np.sqrt(3) * 1e-4, rel=0.4)
    assert noisy.rms_deg == pytest.approx(np.degrees(np.sqrt(3) * 1e-3), rel=0.4)


@pytest.mark.parametrize(("scale", "says"), [(1.03, "2.9% too long"), (0.98, "2.0% too short")])
def test_a_wrong_pitch_is_told_by_the_robots_way(scale: float, says: str) -> None:
    tools, targets = pairs(12, np.ones(3), 1e-4, 1e-3)
    for target in targets:
        target[:3, 3] *= scale
    with pytest.raises(HandEyeError, match=says):
        find_hand_eye(tools, targets)


@pytest.mark.parametrize("scale", [1.0, 1.1])
def test_turns_about_one_point_leave_the_pitch_open(scale: float) -> None:
    """As a robot that turns about its tool centre point: a wrong pitch fits as well."""
    tools, targets = pairs(12, np.ones(3))
    point = tools[0] @ np.array([0.0, 0.0, 0.2, 1.0])
    for k, tool in enumerate(tools):
        target = tool @ HAND_EYE @ targets[k]
        tool[:3, 3] += (point - tool @ np.array([0.0, 0.0, 0.2, 1.0]))[:3]
        targets[k] = inverse_pose(tool @ HAND_EYE) @ target
        targets[k][:3, 3] *= scale
    with pytest.raises(HandEyeError, match="nearly about one point"):
        find_hand_eye(tools, targets)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (pairs(2, np.ones(3)), "2 pairs"),
        (pairs(8, np.zeros(3)), "turns by 0.0°"),
        (pairs(8, np.array([0.0, 0.0, 1.0])), "one axis alone"),
        (pairs(8, np.ones(3), 2e-2, 0.1), "don't agree"),
    ],
    ids=["two", "no turn", "one axis", "noise"],
)
def test_poses_that_show_nothing_are_refused(
    given: tuple[list[np.ndarray], list[np.ndarray]], says: str
) -> None:
    with pytest.raises(HandEyeError, match=says):
        find_hand_eye(*given)


def pass_of(seed: int, half_width_m: float = 0.004) -> Scan:
    """A pass over a plate by a camera that is turned against what its poses say."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.02, 0.02, 200), rng.uniform(-half_width_m, half_width_m, 200)
    dots = np.column_stack([x, y, np.full(200, -0.045)])
    # Looking down: base's z points from the plate to the camera.
    down = Rotation.from_euler("x", 180, degrees=True)
    true = (down * Rotation.from_rotvec(np.radians(TURN_DEG))).as_quat()
    duration_s = 0.06
    events = events_of(
        dots, lambda t: (np.array([0.3 * t - 0.009, 0.0, 0.0]), true), duration_s, camera=ROLLING
    )
    track = track_of(lambda t: (np.array([0.3 * t - 0.009, 0, 0]), down.as_quat()), duration_s)
    return Scan("turned", events, ROLLING, track)


@pytest.fixture(scope="module")
def turned_pass() -> Scan:
    return pass_of(1)


def test_a_flat_pass_shows_how_the_camera_is_turned(turned_pass: Scan) -> None:
    found = find_camera_rotation(turned_pass, (0.043, 0.047))
    assert found.vector_deg[2] == pytest.approx(TURN_DEG[2], abs=0.02)
    assert found.vector_deg[1] == pytest.approx(TURN_DEG[1], abs=0.1)
    assert found.vector_deg[0] == pytest.approx(TURN_DEG[0], abs=0.3)
    assert found.height_m == pytest.approx(-0.045, abs=2e-4)
    assert found.deviation_deg[2] < found.deviation_deg[0]
    before, after = (scan.track.matrices(scan.track.times_ns) for scan in
                     (turned_pass, found.turned(turned_pass)))  # fmt: skip
    np.testing.assert_allclose(after[:, :3, :3], before[:, :3, :3] @ found.rotation, atol=1e-9)
    np.testing.assert_allclose(after[:, :3, 3], before[:, :3, 3])


@pytest.mark.parametrize(("seed", "half_width_m"), [(3, 0.004), (4, 0.002)])
def test_what_texture_leaves_open_is_said(seed: int, half_width_m: float) -> None:
    """All parts of the events see the same texture, and agree on what it puts them off by."""
    found = find_camera_rotation(pass_of(seed, half_width_m), (0.043, 0.047))
    off = np.abs(found.vector_deg - TURN_DEG)
    assert (off < 2 * found.deviation_deg).all()
    assert (found.deviation_deg < [0.6, 0.25, 0.1]).all()


def test_the_cameras_heading_in_base_does_not_matter() -> None:
    scan, heading = pass_of(3), Rotation.from_euler("z", 70, degrees=True)
    track = PoseTrack()
    turned = (heading * Rotation.from_quat(scan.track.quaternions)).as_quat()
    track.extend(scan.track.times_ns, heading.apply(scan.track.positions) + [0.3, -0.2, 0], turned)
    one, other = (
        find_camera_rotation(own, (0.043, 0.047)) for own in (scan, replace(scan, track=track))
    )
    np.testing.assert_allclose(other.vector_deg, one.vector_deg, atol=1e-3)
    np.testing.assert_allclose(other.deviation_deg, one.deviation_deg, rtol=1e-2)


@pytest.mark.parametrize("tilt_deg", [2.0, -2.0])
def test_a_tilt_about_the_rows_is_found_wherever_the_search_begins(
    turned_pass: Scan, tilt_deg: float
) -> None:
    """It blurs the map by less than chance does: what climbs stays where it began."""
    tilt = Rotation.from_rotvec(np.radians([tilt_deg, 0.0, 0.0]))
    poses = (Rotation.from_euler("x", 180, degrees=True) * tilt.inv()).as_quat()
    tilted = track_of(lambda t: (np.array([0.3 * t - 0.009, 0, 0]), poses), 0.06)
    found = find_camera_rotation(replace(turned_pass, track=tilted), (0.043, 0.047))
    true = tilt * Rotation.from_rotvec(np.radians(TURN_DEG))
    off = np.degrees((true.inv() * Rotation.from_matrix(found.rotation)).as_rotvec())
    assert np.abs(off).max() < 0.6
    assert np.abs(off[1:]).max() < 0.15


def test_turn_needs_travel_straightness_and_events(turned_pass: Scan) -> None:
    few = replace(turned_pass, events=turned_pass.events[:5000])
    short, bent = (
        track_of(lambda t, s=s, b=b: (np.array([s * t, b * t * t, 0]), [1, 0, 0, 0]), 0.06)
        for s, b in ((0.1, 0.0), (0.3, 5.0))
    )
    for rolled, says in (
        (few, "too few events"),
        (replace(turned_pass, track=short), "long, less than"),
        (replace(turned_pass, track=bent), "isn't straight"),
    ):
        with pytest.raises(CameraRotationError, match=says):
            find_camera_rotation(rolled, (0.043, 0.047))


def test_turn_refuses_a_plate_that_is_elsewhere(turned_pass: Scan) -> None:
    with pytest.raises(CameraRotationError, match="no plate between"):
        find_camera_rotation(turned_pass, (0.047, 0.051))


def test_a_scan_is_read_in_the_frames_of_the_parameters(tmp_path: Path) -> None:
    """As with `tf_prefix`, where the usual frames aren't in the bag."""

    def prefixed(topic: str, n: int, message: Any) -> Any:
        for item in message.transforms if topic.startswith("/tf") else ():
            item.header.frame_id = f"left_{item.header.frame_id}"
            item.child_frame_id = f"left_{item.child_frame_id}"
        return message

    bag, params = write_bag(tmp_path / "bag", Recipe(edit=prefixed)), tmp_path / "left.yaml"
    names = "base", "tool0_controller", "event_camera_optical_frame"
    keys = "base_frame", "moving_frame", "sensor_frame"
    frames = {key: f"left_{name}" for key, name in zip(keys, names, strict=True)}
    params.write_text(yaml.safe_dump({"/**/emvs": {"ros__parameters": frames}}))
    args = argparse.Namespace(params=params, poses=None, camera=None, topic=None)
    assert len(read_scan(bag, args, 0.1).track) > 5
    args.params = None
    with pytest.raises(CalibrationError, match="no poses base -> tool0_controller"):
        read_scan(bag, args, 0.1)


def test_poses_give_the_cameras_place(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["# tool in base, target in camera"]
    for two in zip(*pairs(8, np.ones(3)), strict=True):
        values = [v for m in two for v in (*m[:3, 3], *Rotation.from_matrix(m[:3, :3]).as_quat())]
        lines.append(" ".join(f"{v:.9f}" for v in values))
    poses, file = tmp_path / "poses.txt", tmp_path / "hand_eye.yaml"
    poses.write_text("\n".join(lines))
    with ControllerProcess():
        robot = ["--robot-ip", LOOPBACK]
        assert main(["calibrate", "hand-eye", str(poses), "-o", str(file), *robot]) == 0
    assert "residuals of 8 pairs" in capsys.readouterr().out
    found = Ur10Parameters.create(read_parameters(file, "ur10"))
    assert found.tcp_offset == (0.0, 0.01, 0.1, 0.0, 0.0, 0.5)
    found = found.hand_eye
    np.testing.assert_allclose(found.matrix, HAND_EYE, atol=1e-6)
    scan = ["--scan", str(world / "plate"), "--camera", str(world / "camera.yaml")]
    turned = tmp_path / "turned.yaml"
    assert main(["calibrate", "hand-eye", *scan, "-o", str(turned)]) == 1
    assert "give it with --params" in capsys.readouterr().err
    assert main(["calibrate", "hand-eye", *scan, "--params", str(file), "-o", str(turned)]) == 0
    assert "doesn't show the camera's position" in capsys.readouterr().out
    again = Ur10Parameters.create(read_parameters(turned, "ur10")).hand_eye
    np.testing.assert_allclose(again.position, found.position, atol=1e-6)
    # The poses were right: the camera stays as it was, within half a degree.
    np.testing.assert_allclose(again.matrix, found.matrix, atol=np.radians(0.5))
    ball = [str(world / "pass"), *scan[2:], "--params", str(file), "-o", str(turned)]
    assert main(["calibrate", "hand-eye", "--scan", *ball]) == 1
    assert "not flat" in capsys.readouterr().err
    poses.write_text("\n".join([*lines, "1 2 3"]))
    assert main(["calibrate", "hand-eye", str(poses)]) == 1
    assert "line 10: expected 14 numbers" in capsys.readouterr().err


def test_a_recording_tells_the_cameras_place_if_it_holds_one(tmp_path: Path) -> None:
    bag, sensor = write_bag(tmp_path / "bag"), "event_camera_optical_frame"
    told = open_recording(bag)
    assert told.hand_eye is None
    assert sum(len(step.events) for step in told.steps())
    np.testing.assert_allclose(told.hand_eye, pose_matrix(HAND_EYE_POSITION, HAND_EYE_ROTATION))
    own = open_recording(bag)
    own.follow(SensorFrames(moving=sensor, sensor=sensor))  # poses that are the camera's own
    assert own.hand_eye is None


def test_a_turn_is_against_the_place_that_was_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever place is given: running the command again must not turn the camera once more."""
    found = CameraRotation(np.array([0.0, 0.0, 1.0]), np.full(3, 0.1), -0.045, 1000)
    monkeypatch.setattr(camera_rotation, "find_camera_rotation", lambda *_: found)
    monkeypatch.setattr(flat_pass, "plate_of", lambda *_: None)
    bag, before, after = write_bag(tmp_path / "bag"), tmp_path / "p.yaml", tmp_path / "t.yaml"
    pairs_record = calibration_record("", [], None, rms_m=2e-4, rms_deg=0.1, pairs=12)
    place = {"hand_eye_m": [0.01, 0.0, 0.08], "hand_eye_quaternion": [0.0, 0.0, 0.0, 1.0]}
    write_calibration(before, "hand_eye", [], {"ur10": place}, pairs_record)
    recorded = Rotation.from_quat(HAND_EYE_ROTATION)
    wanted = (recorded * Rotation.from_euler("z", 1.0, degrees=True)).as_matrix()
    for given in (before, after):
        words = ["calibrate", "hand-eye", "--scan", bag, "--params", given, "--output", after]
        assert main([str(word) for word in words]) == 0
        told = capsys.readouterr().out
        turned = Ur10Parameters.create(read_parameters(after, "ur10")).hand_eye.matrix
        np.testing.assert_allclose(turned[:3, :3], wanted, atol=1e-7)
        np.testing.assert_allclose(turned[:3, 3], [0.01, 0.0, 0.08], atol=1e-7)
        assert "against the one that the recording was made with" in told
        records = read_parameters(after, SECTION)
        assert records["hand_eye"]["pairs"] == 12
        assert records["hand_eye_turn"]["turn_deg"] == [0.0, 0.0, 1.0]
    assert f"place in {after} is turned by 1.000°" in told
    # A recording that holds its place needs no other.
    alone = tmp_path / "alone.yaml"
    assert main(["calibrate", "hand-eye", "--scan", str(bag), "--output", str(alone)]) == 0
    assert "recording was made with" not in capsys.readouterr().out
    turned = Ur10Parameters.create(read_parameters(alone, "ur10")).hand_eye.matrix
    np.testing.assert_allclose(turned[:3, :3], wanted, atol=1e-7)
    np.testing.assert_allclose(turned[:3, 3], HAND_EYE_POSITION, atol=1e-7)
