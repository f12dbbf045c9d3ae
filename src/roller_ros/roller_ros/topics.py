"""The graph's topics, their types and qualities of service."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from roller_msgs.msg import BrailleCell
from rosbags.interfaces import Qos
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from roller_core.bags import bag_qos

from . import qos


@dataclass(frozen=True)
class Topic:
    """A topic of the graph."""

    name: str
    type: Any
    qos: QoSProfile

    @property
    def type_name(self) -> str:
        """The type as bags name it: package/msg/Type."""
        module = self.type.__module__.split(".")[0]
        return f"{module}/msg/{self.type.__name__}"


#: What comes from camera and robot.
INPUTS = (
    Topic("/event_camera/events", EventPacket, qos.EVENTS),
    Topic("/event_camera/camera_info", CameraInfo, qos.LATCHED),
    Topic("/event_camera/image_raw", Image, qos.PREVIEW),
    Topic("/tf", TFMessage, qos.TF),
    Topic("/tf_static", TFMessage, qos.TF_STATIC),
)
#: What the nodes make of it.
OUTPUTS = (
    Topic("/roller/depth/image", Image, qos.DEPTH),
    Topic("/roller/depth/confidence", Image, qos.DEPTH),
    Topic("/roller/depth/camera_info", CameraInfo, qos.DEPTH),
    Topic("/roller/surface/points", PointCloud2, qos.SURFACE),
    Topic("/roller/braille/cells", BrailleCell, qos.BRAILLE),
    Topic("/roller/braille/text", String, qos.BRAILLE),
    Topic("/roller/braille/markers", MarkerArray, qos.MARKERS),
    Topic("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS),
)
ALL = INPUTS + OUTPUTS
EVENTS_TOPIC = INPUTS[0].name
EVENT_TYPE = INPUTS[0].type_name


def recorded(raw: bool = False, events_topic: str = EVENTS_TOPIC) -> list[Topic]:
    """Topics that go into a bag.

    Parameters
    ----------
    raw : bool
        Only what a replay needs: events, calibration and transforms.
    events_topic : str
        Where the event packets are; the camera's other topics lie beside it.
    """
    return [
        Topic(beside(t.name, events_topic), t.type, t.qos)
        for t in (INPUTS if raw else ALL)
        if not (raw and t.type is Image)
    ]


def offered(topic: Topic) -> list[Qos]:
    """A topic's quality of service as a bag holds it, for those who play it."""
    return bag_qos(
        topic.qos.depth,
        topic.qos.reliability == ReliabilityPolicy.RELIABLE,
        topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    )


def beside(name: str, events_topic: str) -> str:
    """What a topic of the graph is called where the event packets are on `events_topic`."""
    if name == EVENTS_TOPIC:
        return events_topic
    ours, theirs = (topic.rsplit("/", 1)[0] for topic in (EVENTS_TOPIC, events_topic))
    return theirs + name.removeprefix(ours) if name.startswith(f"{ours}/") else name
