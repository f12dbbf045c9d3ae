"""Taking all messages of a fast topic that wait, at once.

For every message rclpy's executor asks each entity of the node anew whether it is ready, in Python.
At a thousand packets a second that holds the interpreter's lock for a third of the time, which the
thread that does the work then lacks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

#: Pause after what waited was taken, seconds: packets of some milliseconds are taken together.
_PAUSE_S = 0.002
#: Most messages before others get their turn.
_MOST = 200


def subscribe_draining(
    node: Node,
    message_type: Any,
    topic: str,
    take: Callable[[Any, Mapping[str, Any]], None],
    quality: QoSProfile,
) -> None:
    """Subscribe to a topic of many messages a second.

    Parameters
    ----------
    node : Node
        Node that spins.
    message_type, topic, quality
        As of `Node.create_subscription`.
    take : callable
        Takes each message with rclpy's `MessageInfo`, in order.
    """
    subscription: Subscription[Any]

    def take_waiting(message: Any, info: Mapping[str, Any]) -> None:
        take(message, info)
        with subscription.handle:
            for _ in range(_MOST):
                taken = subscription.handle.take_message(message_type, False)
                if taken is None:
                    break
                take(*taken)
        time.sleep(_PAUSE_S)

    subscription = node.create_subscription(message_type, topic, take_waiting, quality)
