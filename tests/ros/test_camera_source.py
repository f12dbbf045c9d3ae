"""Whose calibration is taken where several publish one."""

import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import CameraInfo

from roller_ros.camera_source import CameraSource

#: A publisher's id: of its process, then its own.
FIRST, OTHER = b"first proces1111", b"other proces1111"
#: The publishers of events of the same processes.
FIRST_EVENTS, OTHER_EVENTS = b"first proces2222", b"other proces2222"


def info(sender: bytes) -> dict[str, object]:
    return {"publisher_gid": {"data": sender}, "received_timestamp": 0}


def of_width(width: int) -> CameraInfo:
    return CameraInfo(width=width)


def test_the_first_is_followed_until_events_say_whose_camera_it_is() -> None:
    cameras, first, other = CameraSource(), of_width(1), of_width(2)
    assert cameras.take(first, info(FIRST), None) is first
    assert cameras.take(other, info(OTHER), FIRST_EVENTS) is None
    assert (cameras.followed, cameras.foreign) == (FIRST, 1)
    # What the other said once holds as soon as its events are followed.
    assert cameras.of_events(OTHER_EVENTS) is other
    assert cameras.of_events(OTHER_EVENTS) is None
    assert cameras.followed == OTHER


def test_the_camera_of_followed_events_goes_before_one_that_came_first() -> None:
    cameras, first, other = CameraSource(), of_width(1), of_width(2)
    assert cameras.take(first, info(FIRST), OTHER_EVENTS) is first
    assert cameras.take(other, info(OTHER), OTHER_EVENTS) is other


def test_another_is_followed_when_the_first_is_gone() -> None:
    cameras, first, other = CameraSource(), of_width(1), of_width(2)
    cameras.take(first, info(FIRST), None)
    cameras.take(other, info(OTHER), None)
    assert cameras.check({FIRST, OTHER}) is None
    assert cameras.check({OTHER}) is other
    assert cameras.check(set()) is None
    assert cameras.followed is None
