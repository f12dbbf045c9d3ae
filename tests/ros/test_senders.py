"""Whom a node follows, where two cameras or two nodes of one kind are in the graph."""

from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import CameraInfo

from roller_core import outputs
from roller_ros import sources
from roller_ros.feeding import NEW_SOURCE
from roller_ros.senders import Senders

EVENTS, CAMERA_INFO, POINTS = outputs.EVENTS, outputs.CAMERA_INFO, outputs.SURFACE_POINTS


class Graph:
    """A node's view of it: who publishes what."""

    def __init__(self) -> None:
        self.publishers: dict[str, list[bytes]] = {}

    def resolve_topic_name(self, name: str) -> str:
        return f"/{name}"

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return [
            SimpleNamespace(endpoint_gid=gid, node_namespace="/", node_name=f"node{gid[0]}")
            for gid in self.publishers.get(topic, [])
        ]


class Following:
    """Senders of a graph, and what they hand on."""

    def __init__(self, *inputs: str) -> None:
        self.graph = Graph()
        self.taken: list[tuple[str, object]] = []
        self.senders = Senders(self.graph, ("base", "tool"), inputs, self._submit)  # type: ignore[arg-type]

    def _submit(self, topic: str, message: object) -> None:
        self.taken.append((topic, message))

    def new(self) -> list[tuple[str, object]]:
        """What was handed on since the last time."""
        found, self.taken = self.taken, []
        return found


def publisher(process: int, number: int) -> bytes:
    return bytes([process] * 12 + [number] * 4)


def info(gid: bytes, at_s: float = 1.0) -> dict[str, Any]:
    return sources.info_of(gid, round(at_s * 1e9))


def test_the_calibration_is_of_the_camera_whose_events_are_taken() -> None:
    following = Following(EVENTS, CAMERA_INFO)
    first, other = CameraInfo(width=1), CameraInfo(width=2)
    following.senders.take_camera(first, info(publisher(1, 0)))
    following.senders.take_camera(other, info(publisher(2, 0)))
    assert following.new() == [(CAMERA_INFO, first)]
    # Its calibration came before its first packet, and is sent but once.
    following.senders.take_packet("packet", info(publisher(2, 1)))
    assert following.new() == [(CAMERA_INFO, other), (EVENTS, "packet")]
    following.senders.take_packet("of another", info(publisher(1, 1), 1.1))
    assert following.new() == []
    # The followed one is silent: the other's packets follow, on its calibration.
    following.senders.take_packet("later", info(publisher(1, 1), 3.0))
    assert following.new() == [(EVENTS, NEW_SOURCE), (CAMERA_INFO, first), (EVENTS, "later")]
    assert following.senders.counts()["foreign_packets"] == 1


def test_the_calibration_of_a_camera_that_is_gone_makes_room() -> None:
    following = Following(EVENTS, CAMERA_INFO)
    first, other = CameraInfo(width=1), CameraInfo(width=2)
    following.senders.take_camera(first, info(publisher(1, 0)))
    following.senders.take_camera(other, info(publisher(2, 0)))
    following.graph.publishers = {f"/{CAMERA_INFO}": [publisher(2, 0)]}
    following.new()
    following.senders.look()
    assert following.new() == [(CAMERA_INFO, other)]


def test_results_are_taken_of_one_process() -> None:
    following = Following(POINTS)
    takes, graph = following.senders.takes_result, following.graph
    graph.publishers = {f"/{POINTS}": [publisher(1, 1), publisher(2, 1)]}
    assert takes(POINTS, info(publisher(1, 1)))
    assert not takes(POINTS, info(publisher(2, 1)))
    assert takes(POINTS, info(publisher(1, 1)))
    assert following.senders.counts() == {"foreign_results": 1}
    # What the node doesn't take as others' work is let through.
    assert takes(CAMERA_INFO, info(publisher(2, 0)))


def test_results_of_another_process_are_taken_when_the_first_is_gone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("roller_ros.senders._LOOK_S", 0.0)
    following = Following(POINTS)
    takes, graph = following.senders.takes_result, following.graph
    graph.publishers = {f"/{POINTS}": [publisher(1, 1)]}
    assert takes(POINTS, info(publisher(1, 1)))
    graph.publishers = {f"/{POINTS}": [publisher(2, 1)]}
    assert takes(POINTS, info(publisher(2, 1)))
    assert not takes(POINTS, info(publisher(1, 1)))
