"""What stages give: plain data with a topic, a time and a frame.

A live node publishes it and a replay writes it, by the same functions (`roller_ros.messages`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import RollerError

#: Topics are relative: a node's namespace goes before them.
EVENTS = "event_camera/events"
CAMERA_INFO = "event_camera/camera_info"
PREVIEW = "event_camera/image_raw"
DEPTH_IMAGE = "roller/depth/image"
DEPTH_CONFIDENCE = "roller/depth/confidence"
DEPTH_SIGMA = "roller/depth/sigma"
DEPTH_INFO = "roller/depth/camera_info"
DEPTH_ACCOUNT = "roller/depth/account"
SURFACE_POINTS = "roller/surface/points"
SURFACE_ACCOUNT = "roller/surface/account"
SURFACE_MAP = "roller/surface/map"
WRENCH = "roller/robot/wrench"
CONTACT = "roller/contact"
BRAILLE_CELLS = "roller/braille/cells"
BRAILLE_TEXT = "roller/braille/text"
BRAILLE_MARKERS = "roller/braille/markers"
FINDINGS = "roller/inspection/findings"
FINDING_MARKERS = "roller/inspection/markers"
DEVIATION = "roller/inspection/deviation"
#: All cells share these; frames have a prefix, and statuses the nodes' full names.
TF, TF_STATIC, DIAGNOSTICS = "/tf", "/tf_static", "/diagnostics"
#: sensor_msgs/PointField's number of the type.
_FLOAT32 = 7


@dataclass(frozen=True)
class Cloud:
    """Points with named columns."""

    #: The first three are x, y, z in metres. Shape (n, len(names)).
    columns: npt.NDArray[np.float32]
    #: Of the columns.
    names: tuple[str, ...]


class CloudError(RollerError):
    """A cloud that isn't one of ours."""


def bag_topic(topic: str) -> str:
    """A topic as bags have it, of nodes without a namespace."""
    return "/" + topic.lstrip("/")


def force_topic(events_topic: str) -> str:
    """Where the robot's force is in a bag with event packets on `events_topic`."""
    ours = events_topic.endswith(bag_topic(EVENTS))
    return (events_topic.removesuffix(EVENTS) if ours else "/") + WRENCH


def stamp_ns(message: Any) -> int:
    """ROS time of a message with a header, rclpy's or rosbags'."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def cloud_of(message: Any) -> Cloud:
    """Columns of a PointCloud2, rclpy's or rosbags', of float32 fields without gaps.

    Raises
    ------
    CloudError
        If its fields are others, or its data aren't whole points.
    """
    names = tuple(field.name for field in message.fields)
    plain = all(
        field.datatype == _FLOAT32 and field.count == 1 and field.offset == 4 * k
        for k, field in enumerate(message.fields)
    )
    if not plain or message.point_step != 4 * len(names) or message.is_bigendian:
        raise CloudError(f"cloud of fields {', '.join(names)}: not float32 one after the other")
    if not names or len(message.data) % message.point_step:
        raise CloudError(f"cloud of {len(message.data)} bytes: no whole points of {names}")
    return Cloud(np.frombuffer(message.data, "<f4").reshape(-1, len(names)), names)


#: How a fault begins that tells of a scan's end, and counts though no points follow.
EVENTS_ENDED = "no events came"


@dataclass(frozen=True)
class ScanFault:
    """What is wrong with a stretch of a scan: no contact between skin and surface, lost data."""

    text: str
    #: What of the scan: "contact", "data".
    part: str = "contact"


@dataclass(frozen=True)
class Output:
    """One thing that goes out."""

    #: Relative name.
    topic: str
    #: What it is of, ROS time, ns.
    t_ns: int
    #: Frame of its coordinates.
    frame_id: str
    #: An image (ndarray, shape (height, width)), a `Camera`, a `Cloud`, a text (str), or plain data
    #: of the package that registered its message.
    data: Any


@dataclass(frozen=True)
class Result:
    """What a stage found, and what goes out of it."""

    #: Depth map, patch of the surface, cell or window without a result; None with a fault alone.
    found: Any
    #: In the order in which they are published.
    outputs: tuple[Output, ...] = ()
    #: What a live node warns of; empty where all is well.
    notice: str = ""
    #: What went wrong with the input.
    fault: RollerError | None = None
