"""Two nodes that publish the robot's poses: noticed, and but one of them followed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription
from tf2_msgs.msg import TFMessage

from roller_core.sensor_pose import transforms_of

from . import qos

#: Silence after which another publisher is followed, and for which a conflict is remembered, s.
_SILENCE_S = 0.5
_REMEMBERED_S = 3.0
#: How long a publisher of poses listens for others, and how long it then doesn't, s.
_WATCH_S = 1.0
_WATCH_PAUSE_S = 5.0


class PoseSources:
    """Keeps to one publisher of the robot's poses where two publish them.

    Two that don't agree would make a surface of neither. The first is followed until it is silent
    for half a second.

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
        self._frames = (base, moving)
        self._clock_s = clock_s
        self._followed: bytes | None = None
        self._heard_s = 0.0
        self._others: dict[bytes, float] = {}
        #: Messages of others, left out.
        self.foreign = 0

    def accepts(self, message: TFMessage, info: Mapping[str, Any]) -> bool:
        """Whether to take a message of /tf.

        Parameters
        ----------
        message : TFMessage
            What came.
        info : mapping
            rclpy's `MessageInfo`; where it doesn't tell the publisher, all are taken.
        """
        gid = info.get("publisher_gid")
        if gid is None or not any(self._is_pose(item) for item in message.transforms):
            return True
        sender, now = bytes(gid["data"]), self._clock_s()
        if sender != self._followed:
            if self._followed is not None and now - self._heard_s < _SILENCE_S:
                self._others[sender] = now
                self.foreign += 1
                return False
            self._followed = sender
        self._heard_s = now
        return True

    def conflict(self, node: Node) -> str:
        """What to tell of publishers that don't agree; empty: there is but one."""
        now = self._clock_s()
        self._others = {k: t for k, t in self._others.items() if now - t < _REMEMBERED_S}
        if not self._others or self._followed is None:
            return ""
        names = {
            bytes(info.endpoint_gid): f"/{info.node_name}"
            for info in node.get_publishers_info_by_topic("/tf")
        }
        first = _name(names, self._followed)
        others = ", ".join(sorted(_name(names, sender) for sender in self._others))
        return (
            f"{first} and {others} publish {' -> '.join(self._frames)} on /tf; {first} is "
            "followed: stop the other, or set publish_tf of ur10 to false"
        )

    def _is_pose(self, item: Any) -> bool:
        return self._frames == (item.header.frame_id.lstrip("/"), item.child_frame_id.lstrip("/"))


def _name(names: Mapping[bytes, str], gid: bytes) -> str:
    # The graph's ids may be shorter than the messages'.
    found: Iterable[str] = (n for k, n in names.items() if k[:16] == gid[:16])
    return next(iter(found), "a node that is gone")


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
        elif self._node.count_publishers("/tf") < 2:
            self.found = False
        elif now >= self._changes_at:
            self._strange = 0
            self._changes_at = now + _WATCH_S
            self._subscription = self._node.create_subscription(
                TFMessage, "/tf", self._take, qos.TF
            )

    def _take(self, message: TFMessage) -> None:
        for item in transforms_of(message, static=False):
            # Any parent: a frame can have but one.
            self._strange += item.child == self._tool and item.t_ns not in self._own
