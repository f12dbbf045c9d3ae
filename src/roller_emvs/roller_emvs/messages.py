"""Points of the surface as messages, for the nodes and for the bag of a replay."""

from __future__ import annotations

from sensor_msgs.msg import PointCloud2

from roller_ros import messages

from .patch import Patch

SURFACE_FIELDS = ("x", "y", "z", "height", "confidence")


def surface_message(patch: Patch, t_ns: int, frame_id: str) -> PointCloud2:
    """Cloud of the points that are done.

    Parameters
    ----------
    patch : Patch
        The points; a point is in one patch only, so the clouds add up.
    t_ns : int
        Stamp, ROS time.
    frame_id : str
        Frame of the points.
    """
    return messages.point_cloud(patch.columns(), SURFACE_FIELDS, t_ns, frame_id)
