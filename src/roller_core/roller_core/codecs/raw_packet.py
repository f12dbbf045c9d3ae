"""A packet's fields straight from its serialized message: its events are not copied."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from . import _kernels
from .decoder import Payload
from .errors import CodecError, PacketLengthError

_ENCAPSULATION = 4


@dataclass(frozen=True, slots=True)
class RawPacket:
    """Fields of a serialized `event_camera_msgs/msg/EventPacket`; its events are not copied."""

    #: `header.stamp`, ns.
    stamp_ns: int
    #: Image size, px.
    height: int
    width: int
    #: Number of the packet.
    seq: int
    #: `time_base`, ns.
    time_base_ns: int
    #: Of the events.
    encoding: str
    #: The events.
    payload: memoryview
    #: Whether their words are big-endian.
    is_bigendian: bool = False

    @property
    def events(self) -> memoryview:
        """As the message has it."""
        return self.payload

    @property
    def time_base(self) -> int:
        """As the message has it."""
        return self.time_base_ns

    @property
    def header(self) -> SimpleNamespace:
        """The stamp, as the message has it."""
        sec, nanosec = divmod(self.stamp_ns, 1_000_000_000)
        return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec))

    @classmethod
    def parse(cls, cdr: bytes | memoryview) -> RawPacket:
        """Read the fields of a message in CDR (OMG DDS-XTypes, version 1, little-endian).

        Raises
        ------
        CodecError
            If it is big-endian or too short for what it says it holds.
        """
        if len(cdr) < _ENCAPSULATION or cdr[1] != 1:
            raise CodecError("event packet: is no little-endian CDR")
        # Alignment counts from after the encapsulation.
        body = memoryview(cdr)[_ENCAPSULATION:]
        try:
            sec, nanosec, length = struct.unpack_from("<iII", body, 0)
            at = _aligned(12 + length, 4)
            height, width = struct.unpack_from("<II", body, at)
            at = _aligned(at + 8, 8)
            seq, time_base, length = struct.unpack_from("<QQI", body, at)
            at += 20
            encoding = bytes(body[at : at + length]).rstrip(b"\0").decode("ascii", "replace")
            is_bigendian = bool(body[at + length])
            at = _aligned(at + length + 1, 4)
            (size,) = struct.unpack_from("<I", body, at)
        except (struct.error, IndexError) as error:
            raise PacketLengthError(f"event packet of {len(cdr)} bytes is cut off") from error
        payload = body[at + 4 : at + 4 + size]
        if len(payload) != size:
            raise PacketLengthError(
                f"event packet {seq} is cut off: {len(payload)} of {size} bytes of events"
            )
        stamp_ns = sec * 1_000_000_000 + nanosec
        return cls(stamp_ns, height, width, seq, time_base, encoding, payload, is_bigendian)


def count_events(encoding: str, payload: Payload) -> int:
    """Number of events in a packet, counted without decoding it; 0 if the encoding isn't known.

    Events that a decoder leaves out for want of a time or a valid mark are counted too.
    """
    raw = np.frombuffer(payload, np.uint8)
    if encoding in ("mono", "libcaer"):
        return len(raw) // 8
    words = raw[: len(raw) // 2 * 2].view("<u2")
    if encoding == "libcaer_cmp":
        return int(_kernels._count_libcaer_cmp(words))
    if encoding == "evt3":
        return int(_kernels._count_evt3(words)[0])
    return 0


def _aligned(at: int, size: int) -> int:
    return -(-at // size) * size
