"""Parameters of the drivers' nodes."""

import numpy as np
import pytest

from roller_core.camera import Camera, CameraError
from roller_core.errors import SettingsError
from roller_driver.dvxplorer.camera_info import load_camera_info
from roller_driver.ur10.robot_settings import Ur10Parameters


def test_the_cameras_place_as_quaternion_or_rotation_vector():
    one = Ur10Parameters(
        hand_eye_m=(0.01, -0.03, 0.08), hand_eye_rotation_rad=(0.0, 0.0, np.pi / 2)
    ).hand_eye
    half = float(np.sqrt(0.5))
    other = Ur10Parameters(
        hand_eye_m=(0.01, -0.03, 0.08), hand_eye_quaternion=(0.0, 0.0, half, half)
    ).hand_eye
    assert np.allclose(one.matrix, other.matrix)
    assert np.allclose(one.matrix[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert not Ur10Parameters().hand_eye_known
    assert Ur10Parameters(hand_eye_identity=True).hand_eye_known


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"hand_eye_quaternion": (0.0, 0.0, 0.0, 2.0)}, "has length 2, not 1"),
        (
            {
                "hand_eye_quaternion": (1.0, 0.0, 0.0, 0.0),
                "hand_eye_rotation_rad": (1.0, 0.0, 0.0),
            },
            "not both",
        ),
        ({"hand_eye_m": (0.0, 1.0)}, "hand_eye_m"),
        ({"hand_eye_m": (12.0, -31.0, 84.0)}, "hand_eye lies 90.3 m away: is it in millimetres"),
        ({"hand_eye_rotation_rad": (0.0, 0.0, 45.0)}, "turned by 45 rad: is it in degrees"),
        ({"tcp_offset": (0.0, 0.0, 120.0, 0.0, 0.0, 0.0)}, "tcp_offset lies 120 m away"),
        ({"tcp_offset": (0.0, 0.0, 0.12, 0.0, 0.0, 180.0)}, "is turned by 180 rad"),
        ({"least_force_n": 50.0, "most_force_n": 20.0}, "most_force_n 20 isn't above least_fo"),
        ({"tcp_offset": (0.0, 0.1, 0.2)}, "tcp_offset has 3 values, not 6"),
    ],
)
def test_a_place_that_makes_no_sense(values, says):
    with pytest.raises(SettingsError, match=says):
        Ur10Parameters.create(values)


def test_the_prefix_goes_before_the_robots_frames_only():
    p = Ur10Parameters(tf_prefix="left_")
    assert (p.base, p.tool, p.sensor_frame) == (
        "left_base", "left_tool0_controller", "event_camera_optical_frame",
    )  # fmt: skip


def test_calibration_by_path_and_by_url(tmp_path):
    path = tmp_path / "a camera.yaml"
    camera = Camera(640, 480, 1000.0, 1001.0, 320.0, 240.0)
    camera.to_yaml(path)
    assert load_camera_info(str(path)) == camera
    assert load_camera_info("file://" + str(path).replace(" ", "%20")) == camera
    with pytest.raises(CameraError, match="only paths and file:// URLs"):
        load_camera_info("package://cell/camera.yaml")
    with pytest.raises(CameraError, match="can't be read"):
        load_camera_info(str(tmp_path / "none.yaml"))
    Camera(346, 260, 300.0, 300.0, 170.0, 130.0).to_yaml(path)
    with pytest.raises(CameraError, match="346x260 sensor, this one has 640x480"):
        load_camera_info(str(path))
