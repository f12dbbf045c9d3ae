"""Two nodes that publish the robot's poses: noticed, and but one of them followed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.frame_transforms import transforms_of

from . import qos
from .sources import OneSource

#: How long a publisher of poses listens for others, and how long it then doesn't, s.
_WATCH_S = 1.0
_WATCH_PAUSE_S = 5.0


class PoseSources(OneSource):
    """Keeps to one publisher of the robot's poses where two publish them.

    Parameters
    ----------
    base, moving : str
        The robot's transform.
    clock_s : callable
        Monotonic time, s.
    """

    def __init__(
        self, base: str, moving: str, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(clock_s=clock_s)
        self._frames = (base, moving)

    def takes(self, message: TFMessage, info: Mapping[str, Any]) -> bool:
        """Whether to take a message of /tf.

        Parameters
        ----------
        message : TFMessage
            What came.
        info : mapping
            rclpy's `MessageInfo`; where it doesn't tell the publisher, all are taken.
        """
        if not any(self._is_pose(item) for item in message.transforms):
            return True
        return self.accepts(info)

    def pose_conflict(self, node: Node) -> str:
        """What to tell of publishers that don't agree; empty: there is but one."""
        what = f"{' -> '.join(self._frames)} on {outputs.TF}"
        return self.conflict(
            node, [outputs.TF], what, "stop the other, or set publish_tf of ur10 to false"
        )

    def _is_pose(self, item: Any) -> bool:
        return self._frames == (item.header.frame_id.lstrip("/"), item.child_frame_id.lstrip("/"))


class OtherPublishers:
    """Looks for others that publish the robot's transform, now and then: /tf can be busy.

    Parameters
    ----------
    node : Node
        Whose subscription it is.
    tool : str
        The frame that it moves.
    """

    def __init__(self, node: Node, tool: str) -> None:
        self._node = node
        self._tool = tool
        self._subscription: Subscription[Any] | None = None
        self._changes_at = 0.0
        self._own: deque[int] = deque(maxlen=2000)
        self._strange = 0
        self.found = False

    def published(self, stamp_ns: int) -> None:
        """Take note of a stamp that this node published."""
        self._own.append(stamp_ns)

    def check(self) -> None:
        """Call about every second."""
        now = time.monotonic()
        if self._subscription is not None:
            if now < self._changes_at:
                return
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
            self._changes_at = now + _WATCH_PAUSE_S
            self.found = self._strange > 0
        elif self._node.count_publishers(outputs.TF) < 2:
            self.found = False
        elif now >= self._changes_at:
            self._strange = 0
            self._changes_at = now + _WATCH_S
            self._subscription = self._node.create_subscription(
                TFMessage, outputs.TF, self._take, qos.TF
            )

    def _take(self, message: TFMessage) -> None:
        for item in transforms_of(message, static=False):
            # Any parent: a frame can have but one.
            self._strange += item.child == self._tool and item.t_ns not in self._own
