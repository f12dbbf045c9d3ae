"""Taking messages of fast topics out of the middleware, many at a time.

A node's executor wakes for each message, and asks each entity of the node anew whether it is ready,
in Python: half a millisecond, in which the thread that does the work lacks the interpreter's lock.
The middleware queues messages anyway, so here a thread looks every few milliseconds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from roller_core.watched_thread import WatchedThread

from .worker import end_process

#: Time between two looks, s.
PERIOD_S = 0.01
#: Most messages of a topic before others get their turn.
_MOST = 200

Take = Callable[[Any, Mapping[str, Any]], None]
#: Makes a message of its serialized form.
Parse = Callable[[bytes], Any]


class Polled(CallbackGroup):
    """Keeps what is in it out of the executor."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing to do."""


class Poller:
    """Takes what came on some topics, in a thread of its own; of a topic in order of arrival.

    Parameters
    ----------
    node : Node
        Whose subscriptions they are.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._group = Polled()
        self._taken: list[tuple[Any, Take, Parse | None]] = []
        self._seen: set[bytes] = set()
        self._stop = threading.Event()
        self._thread: WatchedThread | None = None

    def subscribe(
        self,
        message_type: Any,
        topic: str,
        take: Take,
        quality: QoSProfile,
        parse: Parse | None = None,
    ) -> None:
        """Subscribe to a topic; before `start`.

        Parameters
        ----------
        message_type, topic, quality
            As of `Node.create_subscription`.
        take : callable
            Takes each message with rclpy's `MessageInfo`.
        parse : callable, optional
            Makes what is taken of the serialized message; else rclpy does.
        """
        subscription = subscribe_quietly(
            self._node, message_type, topic, quality, callback_group=self._group
        )
        self._taken.append((subscription, take, parse))

    def start(self) -> None:
        """Begin to take messages."""
        if self._taken:
            self._thread = WatchedThread("poller", self._run, self._stop, end_process)
            self._thread.start()

    def warn_of_unsuited(self) -> None:
        """Say once of each publisher that nothing comes of it, as what it offers doesn't suit."""
        for subscription, _, _ in self._taken:
            name, wanted = subscription.topic_name, subscription.qos_profile
            for publisher in self._node.get_publishers_info_by_topic(name):
                gid = bytes(publisher.endpoint_gid)
                if gid in self._seen:
                    continue
                self._seen.add(gid)
                verdict, why = qos_check_compatible(publisher.qos_profile, wanted)
                if verdict == QoSCompatibility.ERROR:
                    who = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
                    self._node.get_logger().warning(
                        f"nothing comes of {who} on {name}: its quality of service doesn't suit "
                        f"({why})"
                    )

    def stop(self) -> None:
        """Take no more."""
        if self._thread is not None:
            self._thread.end()

    def _run(self) -> None:
        while not self._stop.is_set():
            time.sleep(PERIOD_S)  # a third of what waiting for the end of it takes
            for subscription, take, parse in self._taken:
                for message, info in islice(waiting(subscription, parse is not None), _MOST):
                    take(parse(message) if parse else message, info)


def subscribe_quietly(
    node: Node, message_type: Any, topic: str, quality: QoSProfile, **options: Any
) -> Any:
    """Subscribe without callbacks, whose events would make the executor wake for each message.

    Parameters
    ----------
    node : Node
        Whose subscription it is; `waiting` takes what comes.
    message_type, topic, quality
        As of `Node.create_subscription`.
    **options
        The same.
    """
    none = SubscriptionEventCallbacks(use_default_callbacks=False)
    return node.create_subscription(
        message_type, topic, lambda _: None, quality, event_callbacks=none, **options
    )


def waiting(subscription: Any, raw: bool) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Messages that wait in the middleware, the oldest first, with rclpy's `MessageInfo`.

    None where the subscription or the graph is gone.

    Parameters
    ----------
    subscription : Subscription
        Of the node.
    raw : bool
        Whether they are wanted as they are serialized, else as messages.
    """
    handle, kind = subscription.handle, subscription.msg_type
    try:
        with handle:
            while (item := handle.take_message(kind, raw)) is not None:
                yield item
    except (_rclpy.RCLError, _rclpy.InvalidHandle):
        return
