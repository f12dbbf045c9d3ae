"""The sensor's pose track from /tf and /tf_static."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from roller_core.errors import RollerError
from roller_core.sensor_pose import SensorFrames

from .messages import to_ns

#: Silence after which another publisher is followed, and for which a conflict is remembered, s.
_SILENCE_S = 0.5
_REMEMBERED_S = 3.0


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


def take_transforms(
    frames: SensorFrames,
    message: TFMessage,
    static: bool,
    on_fault: Callable[[RollerError], None],
) -> bool:
    """Feed a message of /tf or /tf_static to `frames`.

    Parameters
    ----------
    frames : SensorFrames
        Takes the transforms.
    message : TFMessage
        What came.
    static : bool
        Whether it came on /tf_static.
    on_fault : callable
        Called with the reason when a transform is refused.

    Returns
    -------
    bool
        Whether the robot moved.
    """
    moved = False
    for item in message.transforms:
        t, r = item.transform.translation, item.transform.rotation
        parent, child = item.header.frame_id.lstrip("/"), item.child_frame_id.lstrip("/")
        position, rotation = (t.x, t.y, t.z), (r.x, r.y, r.z, r.w)
        try:
            if static:
                frames.add_static(parent, child, position, rotation)
            else:
                moved |= frames.add(parent, child, to_ns(item.header.stamp), position, rotation)
        except RollerError as error:
            on_fault(error)
    return moved
