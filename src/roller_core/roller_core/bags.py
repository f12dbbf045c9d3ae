"""rosbag2 types that the workspace reads and writes, for the `rosbags` library."""

from __future__ import annotations

from functools import cache

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

EVENT_PACKET = "event_camera_msgs/msg/EventPacket"
#: The same fields under the name that older recordings carry.
EVENT_ARRAY = "event_array_msgs/msg/EventArray"
BRAILLE_CELL = "roller_msgs/msg/BrailleCell"
FINDING, FINDING_ARRAY = "roller_msgs/msg/Finding", "roller_msgs/msg/FindingArray"

_EVENT_PACKET_MSG = """
std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
"""

_BRAILLE_CELL_MSG = """
std_msgs/Header header
uint32 line
uint32 column
uint8 mask
string pattern
string character
bool readable
geometry_msgs/Point position
float32 confidence
float32[6] dot_confidence
"""

_FINDING_MSG = """
uint32 id
string kind
string region
geometry_msgs/Point center
geometry_msgs/Point[] outline
float64 length
float64 width
float64 depth
float64 area
float64 volume
float64 length_uncertainty
float64 width_uncertainty
float64 depth_uncertainty
float64 area_uncertainty
float64 volume_uncertainty
float32 confidence
string verdict
bool final
"""

_FINDING_ARRAY_MSG = """
std_msgs/Header header
uint32 revision
bool finished
string part
string verdict
string reason
float32 measured
float32 continued
float32 unmeasured
roller_msgs/Finding[] findings
"""


@cache
def typestore() -> Typestore:
    """The typestore with the standard messages, event packets of both names and those of ours."""
    store = get_typestore(Stores.ROS2_KILTED)
    types = get_types_from_msg(_EVENT_PACKET_MSG, EVENT_PACKET)
    types |= get_types_from_msg(_EVENT_PACKET_MSG, EVENT_ARRAY)
    types |= get_types_from_msg(_BRAILLE_CELL_MSG, BRAILLE_CELL)
    types |= get_types_from_msg(_FINDING_MSG, FINDING)
    types |= get_types_from_msg(_FINDING_ARRAY_MSG, FINDING_ARRAY)
    store.register(types)
    return store


def bag_qos(depth: int, reliable: bool = True, latched: bool = False) -> list[Qos]:
    """Quality of service of a topic as a bag's metadata hold it."""
    zero = QosTime(0, 0)
    return [
        Qos(
            QosHistory.KEEP_LAST,
            depth,
            QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
            QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            zero,
            zero,
            QosLiveliness.AUTOMATIC,
            zero,
            False,
        )
    ]
