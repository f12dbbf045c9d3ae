"""Scale, depth range and the camera's place on the tool."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from emvs.scenes import events_of, track_of
from roller_calibration import (
    FlatError,
    HandEyeError,
    Rolled,
    ScaleError,
    TurnError,
    UnsteadyError,
    check_scale,
    find_hand_eye,
    find_plate,
    find_turn,
    scale_of,
    steady_part,
)
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import inverse_pose, pose_matrix, rotation_vector_to_quaternion

CAMERA = Camera(640, 480, 1066.0, 1066.0, 319.5, 239.5)
ROLLING = Camera(320, 140, 800.0, 800.0, 159.5, 69.5)
OPENINGS = [2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0]


def test_scale_is_the_mean_of_the_readings() -> None:
    pixels = np.array(OPENINGS) / 0.0422 + [0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.0, -0.1]
    found = scale_of(OPENINGS, pixels)
    assert found.mm_per_px == pytest.approx(np.mean(OPENINGS / pixels))
    assert found.readings == 8
    assert 0 < found.standard_error_mm_per_px < found.deviation_mm_per_px < found.spread * 0.0422


@pytest.mark.parametrize(
    ("readings", "pixels", "says"),
    [
        ([2.0, 3.0], [47.0], "2 readings in mm and 1 in pixels"),
        ([2.0], [47.0], "1 reading"),
        ([2.0, 0.0], [47.0, 47.0], "reading 2"),
        ([2.0, float("nan")], [47.0, 47.0], "reading 2"),
        ([2.0, 2.0, 3.0, 3.0], [47.4, 47.4, 71.1, 47.4], "reading 4 .* read it again"),
    ],
)
def test_nonsense_is_no_scale(readings: list[float], pixels: list[float], says: str) -> None:
    with pytest.raises(ScaleError, match=says):
        scale_of(readings, pixels)


def test_scale_and_camera_must_agree() -> None:
    assert check_scale(0.0422, 0.045, 1066.0) == pytest.approx(0.0422 * 1066 / 45 - 1)
    for wrong in (0.05, -1.0, float("nan")):
        with pytest.raises(ScaleError):
            check_scale(wrong, 0.045, 1066.0)


def plate(tilt: float = 0.0, bump_m: float = 0.0, count: int = 4000) -> np.ndarray:
    """Points of a plate in the camera's frame, 45 mm away."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-0.012, 0.012, count), rng.uniform(-0.009, 0.009, count)
    z = 0.045 + tilt * x - bump_m * np.exp(-(x**2 + y**2) / (2 * 0.004**2))
    return np.column_stack([x, y, z + rng.normal(0, 3e-5, count)])


def test_depth_range_holds_plate_relief_and_margin() -> None:
    pose = pose_matrix([0.3, -0.2, 0.7], rotation_vector_to_quaternion([3.0, 0.2, 0.1]))
    points = plate(0.02) @ pose[:3, :3].T + pose[:3, 3]
    stray = np.random.default_rng(3).normal(points.mean(axis=0), 0.003, (150, 3))
    found = find_plate(np.concatenate([points, stray]), pose, CAMERA)
    assert found.depth_m == pytest.approx(0.045, abs=1e-5)
    assert found.tilt_deg == pytest.approx((np.degrees(0.02), 0.0), abs=0.03)
    # At the image's border rays meet z = 0.045 + 0.02·x.
    edge = np.array([CAMERA.cx, -CAMERA.cx]) / CAMERA.fx
    assert (found.nearest_m, found.farthest_m) == pytest.approx(
        tuple(np.sort(0.045 / (1 - 0.02 * edge))), abs=2e-5
    )
    low, high = found.depth_range_m(1.5e-3, 0.5e-3)
    assert (found.nearest_m - low, high - found.farthest_m) == pytest.approx((2e-3, 2e-3))


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (plate(bump_m=1e-3), "not flat"),
        (plate(0.15), "leans by 8.5"),
        (plate(count=100), "too few events"),
        (plate() * [0.05, 1, 1], "too little of the plate"),
    ],
    ids=["bump", "tilt", "few", "narrow"],
)
def test_what_is_no_flat_plate_is_refused(points: np.ndarray, says: str) -> None:
    with pytest.raises(FlatError, match=says):
        find_plate(points, np.eye(4), CAMERA)


HAND_EYE = pose_matrix([0.02, -0.013, 0.11], rotation_vector_to_quaternion([0.1, -0.2, 1.3]))


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
    assert np.linalg.norm(noisy.position_m - HAND_EYE[:3, 3]) < 3e-4
    assert noisy.rms_m == pytest.approx(np.sqrt(3) * 1e-4, rel=0.4)
    assert noisy.rms_deg == pytest.approx(np.degrees(np.sqrt(3) * 1e-3), rel=0.4)


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
def test_poses_that_tell_nothing_are_refused(
    given: tuple[list[np.ndarray], list[np.ndarray]], says: str
) -> None:
    with pytest.raises(HandEyeError, match=says):
        find_hand_eye(*given)


TURN_DEG = np.array([0.0, 0.5, -1.1])


@pytest.fixture(scope="module")
def turned_pass() -> Rolled:
    """A pass over a plate by a camera that is turned against what its poses say."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-0.02, 0.02, 200), rng.uniform(-0.004, 0.004, 200)
    dots = np.column_stack([x, y, np.full(200, -0.045)])
    # Looking down: base's z points from the plate to the camera.
    down = Rotation.from_euler("x", 180, degrees=True)
    true = (down * Rotation.from_rotvec(np.radians(TURN_DEG))).as_quat()
    duration_s = 0.06
    events = events_of(
        dots, lambda t: (np.array([0.3 * t - 0.009, 0.0, 0.0]), true), duration_s, camera=ROLLING
    )
    track = track_of(lambda t: (np.array([0.3 * t - 0.009, 0, 0]), down.as_quat()), duration_s)
    return Rolled("turned", events, ROLLING, track)


def test_a_flat_pass_tells_how_the_camera_is_turned(turned_pass: Rolled) -> None:
    found = find_turn(turned_pass, (0.043, 0.047))
    assert found.vector_deg[2] == pytest.approx(TURN_DEG[2], abs=0.05)
    assert found.vector_deg[1] == pytest.approx(TURN_DEG[1], abs=0.3)
    assert found.height_m == pytest.approx(-0.045, abs=2e-4)
    assert found.deviation_deg[2] < found.deviation_deg[0]


def test_turn_needs_way_straightness_and_events(turned_pass: Rolled) -> None:
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
        with pytest.raises(TurnError, match=says):
            find_turn(rolled, (0.043, 0.047))


def test_turn_refuses_a_plate_that_is_elsewhere(turned_pass: Rolled) -> None:
    with pytest.raises(TurnError, match="no plate between"):
        find_turn(turned_pass, (0.047, 0.051))


def stop_and_go(t: float) -> float:
    """Way at a time: 30 ms of standstill, 20 ms of ramp, 60 ms at 0.3 m/s, then slower."""
    ramp, even, after = np.clip(t - 0.03, 0, 0.02), np.clip(t - 0.05, 0, 0.06), max(t - 0.11, 0)
    return float(7.5 * ramp**2 + 0.3 * even + 0.2 * after)


def test_only_the_part_at_one_speed_counts() -> None:
    times = np.arange(0, 140 * 10**6, 100_000)
    x = np.zeros(len(times), np.uint16)
    events = EventArray(x, x, times.astype(np.int64), np.zeros(len(times), np.uint8))
    track = track_of(lambda t: (np.array([0.2, stop_and_go(t), 0]), [1, 0, 0, 0]), 0.14)
    rolled = Rolled("pass", events, ROLLING, track)
    kept = steady_part(rolled, 0.01).events.t_ns * 1e-9
    assert 0.05 <= kept.min() <= 0.063
    assert 0.097 <= kept.max() <= 0.11
    with pytest.raises(UnsteadyError, match=r"pass: .* at one speed, less than 20 mm"):
        steady_part(rolled, 0.02)


@pytest.mark.parametrize("poses", [0, 1, 2, 20])
def test_no_motion_is_no_steady_part(poses: int, turned_pass: Rolled) -> None:
    still = PoseTrack()
    for k in range(poses):
        still.append(k * 8_000_000, [0, 0, 0], [1, 0, 0, 0])
    with pytest.raises(RollerError):
        steady_part(replace(turned_pass, track=still), 0.01)
