"""The sensor's pose track from /tf and /tf_static."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from roller_core.errors import RollerError
from roller_core.frames import SensorFrames

from . import qos
from .messages import to_ns


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


def follow_frames(
    node: Node,
    frames: SensorFrames,
    on_pose: Callable[[], None],
    on_fault: Callable[[RollerError], None],
) -> None:
    """Subscribe to /tf and /tf_static and feed `frames` in the node's callbacks.

    Parameters
    ----------
    node : Node
        Whose subscriptions they are.
    frames : SensorFrames
        Takes the transforms.
    on_pose : callable
        Called after each message that moved the sensor.
    on_fault : callable
        Called with the reason when a transform is refused.
    """

    def dynamic(message: TFMessage) -> None:
        if take_transforms(frames, message, False, on_fault):
            on_pose()

    def static(message: TFMessage) -> None:
        take_transforms(frames, message, True, on_fault)

    node.create_subscription(TFMessage, "/tf", dynamic, qos.TF)
    node.create_subscription(TFMessage, "/tf_static", static, qos.TF_STATIC)
