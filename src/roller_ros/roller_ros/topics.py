"""The graph's topics, their types and qualities of service: one table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from roller_msgs.msg import BrailleCell, FindingArray
from rosbags.interfaces import Qos
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from roller_core import outputs
from roller_core.bags import bag_qos

from . import qos


@dataclass(frozen=True)
class Topic:
    """A topic of the graph."""

    #: Relative to a node's namespace, or with a leading slash where all cells share it.
    name: str
    #: Of its messages.
    type: Any
    #: Quality of service that publishers offer.
    qos: QoSProfile

    @property
    def path(self) -> str:
        """The name without a namespace, as bags have it."""
        return outputs.bag_topic(self.name)

    @property
    def type_name(self) -> str:
        """The type as bags name it: package/msg/Type."""
        module = self.type.__module__.split(".")[0]
        return f"{module}/msg/{self.type.__name__}"


#: What comes from camera and robot.
INPUTS = (
    Topic(outputs.EVENTS, EventPacket, qos.EVENTS),
    Topic(outputs.CAMERA_INFO, CameraInfo, qos.LATCHED),
    Topic(outputs.PREVIEW, Image, qos.PREVIEW),
    Topic(outputs.TF, TFMessage, qos.TF),
    Topic(outputs.TF_STATIC, TFMessage, qos.TF_STATIC),
)
#: What a robot may say beside its poses; nothing needs it.
FORCE = (Topic(outputs.WRENCH, WrenchStamped, qos.TF),)
#: What the nodes make of it.
OUTPUTS = (
    Topic(outputs.DEPTH_IMAGE, Image, qos.DEPTH),
    Topic(outputs.DEPTH_CONFIDENCE, Image, qos.DEPTH),
    Topic(outputs.DEPTH_SIGMA, Image, qos.DEPTH),
    Topic(outputs.DEPTH_INFO, CameraInfo, qos.DEPTH),
    Topic(outputs.DEPTH_ACCOUNT, DiagnosticArray, qos.DEPTH),
    Topic(outputs.CONTACT, DiagnosticArray, qos.BRAILLE),
    Topic(outputs.SURFACE_POINTS, PointCloud2, qos.SURFACE),
    Topic(outputs.SURFACE_ACCOUNT, DiagnosticArray, qos.DEPTH),
    Topic(outputs.SURFACE_MAP, PointCloud2, qos.LATCHED),
    Topic(outputs.BRAILLE_CELLS, BrailleCell, qos.BRAILLE),
    Topic(outputs.BRAILLE_TEXT, String, qos.TEXT),
    Topic(outputs.BRAILLE_MARKERS, MarkerArray, qos.MARKERS),
    Topic(outputs.FINDINGS, FindingArray, qos.LATCHED),
    Topic(outputs.FINDING_MARKERS, MarkerArray, qos.LATCHED),
    Topic(outputs.DEVIATION, PointCloud2, qos.SURFACE),
    Topic(outputs.DIAGNOSTICS, DiagnosticArray, qos.DIAGNOSTICS),
)
ALL = INPUTS + FORCE + OUTPUTS
BY_NAME = {topic.name: topic for topic in ALL}


def publisher(node: Node, name: str) -> Publisher[Any]:
    """A node's publisher of a topic."""
    topic = BY_NAME[name]
    return node.create_publisher(topic.type, topic.name, topic.qos)


def recorded(raw: bool = False, events_topic: str = outputs.EVENTS) -> list[Topic]:
    """Topics that go into a bag; the map holds but points that are there already.

    Parameters
    ----------
    raw : bool
        Only what a replay needs: events, calibration, transforms and force.
    events_topic : str
        Where the event packets are; the camera's other topics lie beside it. Where it is the
        graph's own in a namespace, so are the cell's other topics.
    """
    cell = events_topic.removesuffix(outputs.EVENTS) if _is_a_cells(events_topic) else ""

    def place(name: str) -> str:
        theirs = beside(name, events_topic)
        return theirs if name.startswith("/") or theirs != name else cell + name

    return [
        Topic(place(t.name), t.type, t.qos)
        for t in (INPUTS + FORCE if raw else ALL)
        if not (raw and t.type is Image) and t.name != outputs.SURFACE_MAP
    ]


def _is_a_cells(events_topic: str) -> bool:
    return events_topic.endswith(outputs.bag_topic(outputs.EVENTS))


def offered(topic: Topic) -> list[Qos]:
    """A topic's quality of service as a bag holds it, for those who play it."""
    return bag_qos(
        topic.qos.depth,
        topic.qos.reliability == ReliabilityPolicy.RELIABLE,
        topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    )


def beside(name: str, events_topic: str) -> str:
    """What a topic of the graph is called where the event packets are on `events_topic`."""
    ours, theirs = (topic.rsplit("/", 1)[0] for topic in (outputs.EVENTS, events_topic))
    if name == outputs.EVENTS:
        return events_topic
    return theirs + name.removeprefix(ours) if name.startswith(f"{ours}/") else name
