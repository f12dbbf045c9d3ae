"""The camera that nodes are told of: latched or repeated, and another than was calibrated."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import CameraInfo

from roller_core.camera import Camera
from roller_ros import messages, qos

pytestmark = pytest.mark.graph

CAMERA = Camera(640, 480, 1066.0, 1066.0, 319.5, 239.5)
OTHER = Camera(640, 480, 900.0, 900.0, 319.5, 239.5)
STATUS = {"emvs": "emvs: depth", "surface": "surface: points", "braille": "braille: text"}


def test_parameters_of_another_camera_are_refused(processes, watch):
    """Two nodes with the other camera's parameters stand still and say why; one goes on."""
    watcher = watch()
    for name, camera in (("emvs", OTHER), ("surface", OTHER), ("braille", CAMERA)):
        processes.start(name, f"{{calibrated_camera: {list(camera.intrinsics)}}}")
    info = watcher.node.create_publisher(CameraInfo, "/event_camera/camera_info", qos.LATCHED)
    info.publish(messages.camera_info(CAMERA, 0, "event_camera_optical_frame"))

    def said(name: str, words: str) -> bool:
        return any(words in message for message in watcher.messages_of(STATUS[name]))

    for name in ("emvs", "surface"):
        watcher.spin_until(
            lambda name=name: said(name, "isn't the one"), 40.0, f"refusal by {name}"
        )
        assert said(name, "640×480 px, F 1066.0")
        assert said(name, "calibrate again")
    watcher.spin_until(lambda: said("braille", "no poses"), 40.0, "work of braille")
    assert not said("braille", "isn't the one")
    assert set(processes.stop().values()) == {0}


def test_a_camera_that_repeats_its_calibration_is_heard(processes, watch):
    """Not all drivers latch camera_info."""
    watcher = watch()
    processes.start("braille")
    info = watcher.node.create_publisher(CameraInfo, "/event_camera/camera_info", qos.REPEATED)
    message = messages.camera_info(CAMERA, 0, "event_camera_optical_frame")
    watcher.node.create_timer(0.2, lambda: info.publish(message))
    watcher.spin_until(
        lambda: any("no poses" in said for said in watcher.messages_of(STATUS["braille"])),
        40.0,
        "calibration",
    )
    assert "incompatible" not in processes.log("braille")
    assert set(processes.stop().values()) == {0}
