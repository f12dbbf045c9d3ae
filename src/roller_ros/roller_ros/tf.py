"""The sensor's pose track from /tf and /tf_static."""

from __future__ import annotations

from collections.abc import Callable

from tf2_msgs.msg import TFMessage

from roller_core.errors import RollerError
from roller_core.frames import SensorFrames

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
