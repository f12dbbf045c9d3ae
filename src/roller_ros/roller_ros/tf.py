"""The sensor's pose track from /tf and /tf_static."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from roller_core.errors import RollerError
from roller_core.frames import SensorFrames

from . import qos
from .messages import to_ns


def follow_frames(
    node: Node,
    frames: SensorFrames,
    on_pose: Callable[[], None],
    on_fault: Callable[[RollerError], None],
) -> None:
    """Subscribe to /tf and /tf_static and feed `frames`.

    Parameters
    ----------
    node : Node
        Whose subscriptions they are.
    frames : SensorFrames
        Takes the transforms.
    on_pose : callable
        Called after each message that moved the sensor.
    on_fault : callable
        Called with the reason when a pose is refused.
    """

    def dynamic(message: TFMessage) -> None:
        moved = False
        for item in message.transforms:
            t, r = item.transform.translation, item.transform.rotation
            try:
                moved |= frames.add(
                    item.header.frame_id.lstrip("/"),
                    item.child_frame_id.lstrip("/"),
                    to_ns(item.header.stamp),
                    (t.x, t.y, t.z),
                    (r.x, r.y, r.z, r.w),
                )
            except RollerError as error:
                on_fault(error)
        if moved:
            on_pose()

    def static(message: TFMessage) -> None:
        for item in message.transforms:
            t, r = item.transform.translation, item.transform.rotation
            try:
                frames.add_static(
                    item.header.frame_id.lstrip("/"),
                    item.child_frame_id.lstrip("/"),
                    (t.x, t.y, t.z),
                    (r.x, r.y, r.z, r.w),
                )
            except RollerError as error:
                on_fault(error)

    node.create_subscription(TFMessage, "/tf", dynamic, qos.TF)
    node.create_subscription(TFMessage, "/tf_static", static, qos.TF_STATIC)
