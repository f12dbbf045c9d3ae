"""Whom a node follows, of the senders of each of its topics."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

from roller_core import outputs

from . import topics
from .camera_source import CameraSource
from .feeding import NEW_SOURCE
from .sources import OneSource, publishers
from .tf import PoseSources

#: A sender that isn't followed is looked up in the graph no more often, s.
_LOOK_S = 0.2


class Senders:
    """Keeps to one camera, one robot and one process's results.

    Messages are taken by the poller and by the thread that spins, so each is judged and handed on
    under one lock.

    Parameters
    ----------
    node : Node
        Knows the graph.
    frames : tuple of str
        Base frame and moving frame of the poses.
    inputs : collection of str
        Topics that the node takes.
    submit : callable
        Takes a topic and what came on it, if it counts.
    """

    def __init__(
        self,
        node: Node,
        frames: tuple[str, str],
        inputs: Collection[str],
        submit: Callable[[str, Any], object],
    ) -> None:
        self._node, self._submit = node, submit
        self._looked_s = 0.0
        self._lock = threading.RLock()
        self._poses = PoseSources(*frames)
        self._events, self._cameras = OneSource(), CameraSource[CameraInfo]()
        #: Of all topics that other nodes of the graph work out: depth maps, points.
        self._results = OneSource(latched=True, processes=True)
        ours = {topic.name for topic in topics.OUTPUTS} - {outputs.CONTACT}
        self._taken_results = [node.resolve_topic_name(name) for name in inputs if name in ours]
        self._takes_events, self._takes_poses = outputs.EVENTS in inputs, outputs.TF in inputs

    def take_poses(self, message: TFMessage, info: Mapping[str, Any]) -> None:
        """Hand on poses of the robot that is followed."""
        with self._lock:
            if self._poses.takes(message, info):
                self._submit(outputs.TF, message)

    def take_packet(self, packet: object, info: Mapping[str, Any]) -> None:
        """Hand on a packet of the camera that is followed; before the first its calibration."""
        with self._lock:
            before = self._events.followed
            if not self._events.accepts(info):
                return
            if before != self._events.followed:
                if before is not None:
                    self._submit(outputs.EVENTS, NEW_SOURCE)
                self._submit_camera(self._cameras.of_events(self._events.followed))
            self._submit(outputs.EVENTS, packet)

    def take_camera(self, message: CameraInfo, info: Mapping[str, Any]) -> None:
        """Hand on the calibration of the camera whose events are followed."""
        with self._lock:
            self._submit_camera(self._cameras.take(message, info, self._events.followed))

    def takes_result(self, name: str, info: Mapping[str, Any]) -> bool:
        """Whether to take a message that another node of the graph has worked out.

        It is of the process that is followed, or of that node started again.
        """
        if self._node.resolve_topic_name(name) not in self._taken_results:
            return True
        if self._results.accepts(info):
            return True
        before, now_s = self._results.followed, time.monotonic()
        if now_s - self._looked_s < _LOOK_S:
            return False
        self._looked_s = now_s
        self._keep_to_results()
        return before != self._results.followed and self._results.accepts(info)

    def look(self) -> None:
        """Follow others where those that were followed are gone, or send but some of the topics."""
        with self._lock:
            if self._takes_events:
                alive = publishers(self._node, self._node.resolve_topic_name(outputs.CAMERA_INFO))
                self._submit_camera(self._cameras.check(alive))
            self._keep_to_results()

    def conflict(self) -> str:
        """Publishers that don't agree; empty: there is but one of each topic."""
        with self._lock:
            if conflict := self._poses.pose_conflict(self._node):
                return conflict
            for source, names in (
                (self._events, [self._node.resolve_topic_name(outputs.EVENTS)]),
                (self._cameras, [self._node.resolve_topic_name(outputs.CAMERA_INFO)]),
                (self._results, self._taken_results),
            ):
                what = ", ".join(names)
                if conflict := source.conflict(self._node, names, what, "stop all but one"):
                    return conflict
            return ""

    def counts(self) -> dict[str, object]:
        """Messages of others, left out, by what a status calls them."""
        with self._lock:
            left_out: dict[str, object] = {}
            if self._takes_poses:
                left_out["foreign_poses"] = self._poses.foreign
            if self._taken_results:
                left_out["foreign_results"] = self._results.foreign
            if self._takes_events:
                left_out["foreign_packets"] = self._events.foreign
                left_out["foreign_camera_infos"] = self._cameras.foreign
            return left_out

    def _keep_to_results(self) -> None:
        by_topic = [publishers(self._node, name) for name in self._taken_results]
        alive = {sender: name for found in by_topic for sender, name in found.items()}
        self._results.keep_to(alive, whole=by_topic)
        self._results.keep_to_name(alive)

    def _submit_camera(self, camera: CameraInfo | None) -> None:
        if camera is not None:
            self._submit(outputs.CAMERA_INFO, camera)
