"""Takes messages of many topics out of the middleware, many at a time.

A node's executor wakes for each message; at a thousand packets a second that alone takes half a
core. The middleware queues messages anyway, so here a thread looks every few milliseconds and
takes all there are, with the time at which each arrived.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from event_camera_msgs.msg import EventPacket
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from sensor_msgs.msg import Image, PointCloud2

from roller_core.watched_thread import WatchedThread
from roller_recording.raw_message import RawMessage
from roller_ros.polling import PERIOD_S, Polled, subscribe_quietly, waiting
from roller_ros.sources import publisher_of
from roller_ros.topics import Topic
from roller_ros.worker import end_process

#: Most that is taken of a topic at once: what comes faster than it can be taken must not pile up.
_MOST_BYTES = 50_000_000


class PolledSubscriptions:
    """Subscribes to topics and hands on what comes, in order of arrival.

    Parameters
    ----------
    node : Node
        Whose subscriptions they are.
    topics : iterable of Topic
        What to take.
    take : callable
        Takes a list of messages, in a thread of the polled subscriptions.
    on_overflow : callable
        Takes a topic and a time, ns, when the middleware's queue was full: then messages may have
        been lost there.
    """

    def __init__(
        self,
        node: Node,
        topics: Iterable[Topic],
        take: Callable[[list[RawMessage]], None],
        on_overflow: Callable[[str, int], None],
    ) -> None:
        self._node = node
        self._take = take
        self._on_overflow = on_overflow
        self._group = Polled()
        self._held: list[RawMessage] = []
        self._stop = threading.Event()
        asked = [(t, _patient(t)) for t in topics]
        self._subscriptions = [(t, qos, self._subscribe(t, qos)) for t, qos in asked]
        self._thread = WatchedThread("recording", self._run, self._stop, end_process)
        self._thread.start()

    def stop(self) -> None:
        """Take what has arrived and no more."""
        self._thread.end()
        self._poll(last=True)

    def match_publishers(self) -> None:
        """Ask for less where a publisher offers less; call this now and then.

        A driver's camera_info need not be latched, say. A subscription that asks for more than is
        offered gets nothing at all.
        """
        for k, (topic, qos, old) in enumerate(self._subscriptions):
            for publisher in self._node.get_publishers_info_by_topic(topic.name):
                offered = publisher.qos_profile
                verdict, _ = qos_check_compatible(offered, qos)
                if verdict == QoSCompatibility.ERROR:
                    less = _lesser(qos, offered)
                    if (less.durability, less.reliability) != (qos.durability, qos.reliability):
                        self._subscriptions[k] = (topic, less, self._subscribe(topic, less))
                        self._node.destroy_subscription(old)
                        break

    def _subscribe(self, topic: Topic, qos: QoSProfile) -> Any:
        return subscribe_quietly(
            self._node, topic.type, topic.name, qos, raw=True, callback_group=self._group
        )

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            self._poll()

    def _poll(self, last: bool = False) -> None:
        """Take all that has arrived; what arrived meanwhile is held, for the sake of order."""
        now_ns = time.time_ns()
        found, self._held = self._held, []
        for topic, qos, subscription in list(self._subscriptions):
            taken = _take_all(topic.name, subscription)
            if len(taken) >= qos.depth > 1:
                self._on_overflow(topic.name, taken[0].t_ns)
            found += taken
        found.sort(key=lambda message: message.t_ns)
        if not last:
            self._held = [m for m in found if m.t_ns > now_ns]
            found = found[: len(found) - len(self._held)]
        if found:
            self._take(found)


def _take_all(name: str, subscription: Any) -> list[RawMessage]:
    found: list[RawMessage] = []
    size = 0
    for data, info in waiting(subscription, raw=True):
        size += len(data)
        # Not every middleware says when a message arrived.
        t_ns = info.get("received_timestamp") or time.time_ns()
        found.append(RawMessage(t_ns, name, data, sender=publisher_of(info) or b""))
        if size >= _MOST_BYTES:
            break
    return found


def _patient(topic: Topic) -> QoSProfile:
    """A topic's quality of service with a longer queue, for a process that can be held up."""
    depth = {EventPacket: 1000, Image: 50, PointCloud2: 50}.get(topic.type, 2000)
    return QoSProfile(
        depth=max(depth, topic.qos.depth),
        durability=topic.qos.durability,
        reliability=topic.qos.reliability,
    )


def _lesser(qos: QoSProfile, offered: QoSProfile) -> QoSProfile:
    durability, reliability = qos.durability, qos.reliability
    if offered.durability == DurabilityPolicy.VOLATILE:
        durability = DurabilityPolicy.VOLATILE
    if offered.reliability == ReliabilityPolicy.BEST_EFFORT:
        reliability = ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=qos.depth, durability=durability, reliability=reliability)
