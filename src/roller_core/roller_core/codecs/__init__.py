"""Codecs for the event packets that ROS event cameras publish.

The five encodings of ``event_camera_msgs/msg/EventPacket`` are decoded (`mono`, `libcaer`,
`libcaer_cmp`, `evt3`, `trigger`), four are encoded.
"""

from __future__ import annotations

from .decoder import DecodedPacket, PacketDecoder, Payload, unknown_words
from .encoder import MAX_SPAN_NS, encode
from .errors import CodecError, PacketLengthError, PacketTimeError, UnknownEncodingError
from .raw_packet import RawPacket, count_events

ENCODED_ENCODINGS = ("mono", "libcaer", "libcaer_cmp", "evt3")

__all__ = [
    "ENCODED_ENCODINGS",
    "MAX_SPAN_NS",
    "CodecError",
    "DecodedPacket",
    "PacketDecoder",
    "PacketLengthError",
    "PacketTimeError",
    "Payload",
    "RawPacket",
    "UnknownEncodingError",
    "count_events",
    "encode",
    "unknown_words",
]
