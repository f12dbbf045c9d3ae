"""One camera is recorded where several send: a bag of two at once can't be processed."""

from __future__ import annotations

import threading
from collections.abc import Collection, Sequence
from dataclasses import replace

from rclpy.node import Node

from roller_recording.raw_message import RawMessage
from roller_ros.camera_source import CameraSource
from roller_ros.sources import OneSource, info_of

from .losses import Losses


class OneCamera:
    """Keeps to the camera that the graph's nodes would follow, and counts packets of others.

    Parameters
    ----------
    events, camera_info : str
        Topics of its packets and of its calibration.
    losses : Losses
        The account.
    """

    def __init__(self, events: str, camera_info: str, losses: Losses) -> None:
        self._topics = events, camera_info
        self._losses = losses
        self._events, self._infos = OneSource(), CameraSource[RawMessage]()
        self._alive: Collection[bytes] | None = None
        self._lock = threading.Lock()

    def keep(self, messages: Sequence[RawMessage]) -> list[RawMessage]:
        """Of messages in order of arrival those to record."""
        events, camera_info = self._topics
        kept: list[RawMessage] = []
        with self._lock:
            alive, self._alive = self._alive, None
            if alive is not None and messages:
                kept += _at(messages[0].t_ns, self._infos.check(alive))
            for message in messages:
                if message.topic == events:
                    kept += self._packet(message)
                elif message.topic == camera_info:
                    kept += self._camera_info(message)
                else:
                    kept.append(message)
        return kept

    def see_publishers(self, alive: Collection[bytes]) -> None:
        """Those that publish camera_info now; the followed one may be gone."""
        self._alive = alive

    def conflict(self, node: Node) -> str:
        """What to tell of two cameras; empty: there is but one."""
        with self._lock:
            return self._events.conflict(
                node, self._topics[:1], self._topics[0], "stop all but one"
            )

    def _packet(self, message: RawMessage) -> list[RawMessage]:
        if not self._events.accepts(info_of(message.sender, message.t_ns)):
            self._losses.leave_to_others(message)
            return []
        return [*_at(message.t_ns, self._infos.of_events(self._events.followed)), message]

    def _camera_info(self, message: RawMessage) -> list[RawMessage]:
        info = info_of(message.sender, message.t_ns)
        return _at(message.t_ns, self._infos.take(message, info, self._events.followed))


def _at(t_ns: int, said: RawMessage | None) -> list[RawMessage]:
    """What was said earlier, if anything, at the time from which it holds."""
    return [] if said is None else [replace(said, t_ns=t_ns)]
