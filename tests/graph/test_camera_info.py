"""The camera that nodes hear of: repeated, and another than was calibrated."""

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
    """Two nodes with the other camera's parameters stand still and say why; one goes on.

    The calibration is repeated, not latched: not all drivers latch it.
    """
    watcher = watch()
    for name, camera in (("emvs", OTHER), ("surface", OTHER), ("braille", CAMERA)):
        processes.start(name, f"{{calibrated_camera: {list(camera.intrinsics)}}}")
    info = watcher.node.create_publisher(CameraInfo, "/event_camera/camera_info", qos.REPEATED)
    message = messages.camera_info(CAMERA, 0, "event_camera_optical_frame")
    watcher.node.create_timer(0.2, lambda: info.publish(message))

    def said(name: str, words: str) -> bool:
        return watcher.has_said(STATUS[name], words)

    for name in ("emvs", "surface"):
        watcher.spin_until(
            lambda name=name: said(name, "isn't the one"), 90.0, f"refusal by {name}"
        )
        assert said(name, "640×480 px, F 1066.0")
        assert said(name, "calibrate again")
    watcher.spin_until(lambda: said("braille", "no poses"), 90.0, "work of braille")
    assert not said("braille", "isn't the one")
    assert "incompatible" not in processes.log("braille")
    assert set(processes.stop().values()) == {0}
