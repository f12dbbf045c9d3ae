"""The example of a rolling pass: its line, speed and ramps, and what a controller makes of it."""

import re
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from driver.emulation.controller_process import ControllerProcess
from own import LOOPBACK
from roller_bringup.cli import main
from roller_core.errors import RollerError
from roller_driver.motion.kinematics import ARMS, KinematicsError
from roller_driver.motion.programs import joint_trajectory, urscript
from roller_driver.motion.rolling_pass import RollingPass

NEAR_RAD = np.radians([10.0, -80.0, 110.0, -120.0, -90.0, 0.0])
TCP = np.eye(4)
TCP[2, 3] = 0.15
SPEED = 0.25


def rolling(**other: object) -> RollingPass:
    values = {"start_m": (0.55, -0.2, 0.1), "end_m": (0.75, -0.15, 0.1), "speed_m_s": SPEED}
    return RollingPass.create({**values, **other}, "test")


@given(speed=st.floats(0.005, 0.5), acceleration=st.floats(0.05, 3.0), length=st.floats(0.005, 1.5))
def test_speed_and_acceleration_are_kept(speed: float, acceleration: float, length: float) -> None:
    a_pass = rolling(end_m=(0.55 + length, -0.2, 0.1), speed_m_s=speed,
                     acceleration_m_s2=acceleration)  # fmt: skip
    t = np.linspace(0, a_pass.duration_s, 5001)
    x = a_pass.positions_m(t)[:, 0]
    v = np.gradient(x, t)
    assert v.max() <= speed * (1 + 1e-3)
    assert np.abs(np.gradient(v, t))[2:-2].max() <= acceleration * 1.02
    over_part = (x >= 0.55 + 1e-6) & (x <= 0.55 + length - 1e-6)
    assert v[over_part][3:-3] == pytest.approx(speed, rel=5e-3)
    before, after = a_pass.ends_m
    assert (x[0], x[-1]) == pytest.approx((before[0], after[0]), abs=1e-9)


@pytest.mark.parametrize("name", ["ur10", "ur10e"])
def test_joints_come_back_from_their_flange(name: str) -> None:
    arm, rng = ARMS[name], np.random.default_rng(1)
    for _ in range(20):
        true = NEAR_RAD + rng.uniform(-0.3, 0.3, 6)
        found = arm.joints(arm.flange(true), true + rng.uniform(-0.15, 0.15, 6))
        np.testing.assert_allclose(found, true, atol=1e-8)
        step = 1e-6 * np.eye(6)
        slopes = [(arm.flange(true + s) - arm.flange(true - s))[:3, 3] / 2e-6 for s in step]
        np.testing.assert_allclose(arm.jacobian(true)[:3].T, slopes, atol=1e-8)
    # All stretched upwards, as Universal Robots' own table has it.
    d = arm.d_m
    up = arm.flange(np.array([0, -np.pi / 2, 0, -np.pi / 2, 0, 0]))[:3, 3]
    assert up == pytest.approx([0, -d[3] - d[5], d[0] - arm.a_m[1] - arm.a_m[2] + d[4]], abs=1e-9)


def test_the_trajectory_stays_on_the_line_within_a_micrometre() -> None:
    a_pass = rolling()
    points = joint_trajectory(a_pass, ARMS["ur10"], NEAR_RAD, TCP)["trajectory"]["points"]
    t = np.array([p["time_from_start"]["sec"] + p["time_from_start"]["nanosec"] * 1e-9
                  for p in points])  # fmt: skip
    poses = [ARMS["ur10"].flange(np.array(p["positions"])) @ TCP for p in points]
    np.testing.assert_allclose([pose[:3, 3] for pose in poses], a_pass.positions_m(t), atol=1e-6)
    turned = [Rotation.from_matrix(p[:3, :3]).as_rotvec() for p in poses]
    assert np.ptp(np.abs(turned), axis=0).max() < 1e-6
    assert points[0]["velocities"] == points[-1]["velocities"] == [0.0] * 6


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"end_m": (0.5501, -0.2, 0.1)}, "0.1 mm apart"),
        ({"end_m": (500.0, -0.2, 0.1)}, "500 m from the robot's base"),
        ({"speed_m_s": 0.7}, "speed_m_s"),
        ({"rotation_rad": (180.0, 0.0, 0.0)}, "180 rad long.*in degrees"),
        ({"end_m": (2.0, -0.2, 0.1)}, "out of reach"),
        ({"start_m": (0.9, -0.2, 0.1), "end_m": (1.3, -0.2, 0.1)}, "out of reach"),
        ({"start_m": (0.12, -0.2, 0.1), "speed_m_s": 0.5}, "limit|singularity"),
    ],
)
def test_what_cannot_be_rolled_is_refused(change: dict[str, object], says: str) -> None:
    with pytest.raises(RollerError, match=says):
        joint_trajectory(rolling(**change), ARMS["ur10"], NEAR_RAD, TCP)
    assert issubclass(KinematicsError, RollerError)


def test_a_joint_that_would_turn_further_than_it_can_is_refused() -> None:
    """Any whole turn more gives the same place, and Newton's method keeps what it is given."""
    far = NEAR_RAD + [0, 0, 0, 0, 0, 2 * np.pi]
    with pytest.raises(KinematicsError, match=r"wrist_3_joint would turn to \d+°, more than 360°"):
        joint_trajectory(rolling(), ARMS["ur10"], far, TCP)


def test_ramps_that_lead_out_of_reach_give_no_script() -> None:
    with pytest.raises(KinematicsError, match=r"ramps of 2500 mm lead to 3.\d+ m"):
        urscript(rolling(speed_m_s=0.5, acceleration_m_s2=0.1))


@pytest.mark.parametrize("where", ["--joints-deg 10 -80 nan -120 -90 0", "--tcp-m 0 0 inf"])
def test_a_place_that_is_no_number(where: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = "motion --start-m 0.55 -0.2 0.1 --end-m 0.75 -0.15 0.1 --trajectory never.yaml".split()
    joints = "--joints-deg 10 -80 110 -120 -90 0".split()
    assert main([*words, *joints, *where.split()]) == 1
    assert "--joints-deg and --tcp-m must be finite" in capsys.readouterr().err


def test_the_trajectory_says_where_the_arm_must_stand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A controller goes to the first point at once, from wherever the arm is."""
    file = tmp_path / "pass.yaml"
    words = "motion --start-m 0.55 -0.2 0.1 --end-m 0.75 -0.15 0.1 --tcp-m 0 0 0.15".split()
    joints = ["--joints-deg", *(f"{q:.3f}" for q in np.degrees(NEAR_RAD))]
    assert main([*words, "--trajectory", str(file), *joints]) == 0
    points = yaml.safe_load(file.read_text())["trajectory"]["points"]
    first = ", ".join(f"{q:.1f}°" for q in np.degrees(points[0]["positions"]))
    for text in (capsys.readouterr().out, file.read_text()):
        assert f"the arm must stand here when it starts: {first}" in text


def test_the_script_lifts_presses_and_says_whose_risk_it_is() -> None:
    script = urscript(rolling(force_n=20.0))
    lines = script.splitlines()
    # What the controller asks of a script that it is sent.
    assert (lines[0], lines[-1]) == ("def roll_pass():", "end")
    assert all(line.startswith("  ") for line in lines[1:-1])
    assert script.isascii()
    assert "# EXAMPLE" in lines[1]
    assert "calls roll_pass()" in script
    assert "risk assessment" in script
    moves = re.findall(r"movel\(p\[(.*?)\], a=([\d.]+), v=([\d.]+)\)", script)
    places = np.array([[float(v) for v in pose.split(",")] for pose, _, _ in moves])
    before, after = rolling().ends_m
    np.testing.assert_allclose(places[1:3, :3], [before, after], atol=1e-6)
    assert (places[[0, 3], 2] > places[[1, 2], 2] + 0.04).all()
    assert float(moves[2][2]) == SPEED
    order = [script.index(word) for word in ("force_mode(", "v=0.25", "end_force_mode()")]
    assert order == sorted(order)
    assert "force_mode" not in urscript(rolling())


def test_what_is_written_again_replaces_it_unless_it_was_edited(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "motion --start-m 0.55 -0.2 0.1 --end-m 0.75 -0.15 0.1 --tcp-m 0 0 0.15".split()
    files = [tmp_path / name for name in ("pass.script", "pass.yaml")]
    joints = ["--joints-deg", *(f"{q:.3f}" for q in np.degrees(NEAR_RAD))]
    written = ["--script", str(files[0]), "--trajectory", str(files[1]), *joints]
    for speed in ("0.25", "0.2"):
        assert main([*words, "--speed", speed, *written]) == 0
    script = files[0].read_text().splitlines()
    assert (script[0], script[-1]) == ("def roll_pass():", "end")
    assert "v=0.2)" in files[0].read_text()
    yaml.safe_load(files[1].read_text())
    assert {path.name for path in tmp_path.iterdir()} == {"pass.script", "pass.yaml"}
    for file in files:
        file.write_text(edited := file.read_text().replace("0.1", "0.11", 1))
        capsys.readouterr()
        assert main([*words, "--speed", "0.25", *written]) == 1
        assert f"{file}: was changed since roller wrote it" in capsys.readouterr().err
        assert file.read_text() == edited
        file.unlink()


def test_a_controller_that_follows_it_rolls_at_one_speed(tmp_path: Path) -> None:
    pytest.importorskip("rtde_receive", reason="ur_rtde has no wheels for this Python")
    from driver.test_ur10_receiver import Running

    file = tmp_path / "pass.yaml"
    words = "motion --start-m 0.55 -0.2 0.1 --end-m 0.75 -0.15 0.1 --speed 0.25 --tcp-m 0 0 0.15"
    joints = [f"{q:.3f}" for q in np.degrees(NEAR_RAD)]
    assert main([*words.split(), "--trajectory", str(file), "--joints-deg", *joints]) == 0
    points = yaml.safe_load(file.read_text())["trajectory"]["points"]
    t = [p["time_from_start"]["sec"] + p["time_from_start"]["nanosec"] * 1e-9 for p in points]
    tools = [ARMS["ur10"].flange(np.array(p["positions"])) @ TCP for p in points]
    turn = np.array([np.pi, 0.0, 0.0])
    poses = np.array([[*tool[:3, 3], *turn] for tool in tools])
    np.savez(tmp_path / "pass.npz", t_s=t, pose=poses)
    with (
        ControllerProcess(trajectory=str(tmp_path / "pass.npz")) as controller,
        Running() as running,
    ):
        running.wait_for(10)
        controller.send(f"start {time.monotonic() + 0.2}")
        running.wait(lambda: running.samples[-1].pose[0] > 0.749, timeout_s=30)
    x = np.array([s.pose[:3] for s in running.samples])
    t_s = np.array([s.controller_ns for s in running.samples]) * 1e-9
    along = (x - [0.55, -0.2, 0.1]) @ [0.2, 0.05, 0.0] / np.hypot(0.2, 0.05)
    over = (along > 0.005) & (along < 0.195)
    speed = np.gradient(along[over], t_s[over])
    assert np.median(speed) == pytest.approx(SPEED, rel=1e-3)
    assert speed == pytest.approx(SPEED, rel=0.02)
    assert LOOPBACK.startswith("127.")
