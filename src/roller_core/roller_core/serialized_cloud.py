"""A cloud's points straight from its serialized message: they are not copied."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from types import SimpleNamespace

from .outputs import Cloud, CloudError, cloud_of

_ENCAPSULATION = 4
#: Ours have six; what is nonsense may say any number.
_MOST_FIELDS = 64


@dataclass(frozen=True, slots=True)
class SerializedCloud:
    """What a serialized `sensor_msgs/msg/PointCloud2` holds."""

    #: `header.stamp`, ns.
    stamp_ns: int
    #: Frame of the points.
    frame_id: str
    #: The points, in the message's memory.
    cloud: Cloud

    @classmethod
    def parse(cls, cdr: bytes | memoryview) -> SerializedCloud:
        """Read a message in CDR (OMG DDS-XTypes, version 1, little-endian).

        Raises
        ------
        CloudError
            If it is big-endian or too short for what it says it holds, or no cloud that `cloud_of`
            takes.
        """
        if len(cdr) < _ENCAPSULATION or cdr[1] != 1:
            raise CloudError("cloud: is no little-endian CDR")
        read = _Reader(memoryview(cdr)[_ENCAPSULATION:])
        try:
            sec, nanosec = read.words("<iI")
            frame_id = read.text()
            _height, _width, count = read.words("<III")
            if count > _MOST_FIELDS:
                raise CloudError(f"cloud of {count} fields")
            fields = [read.field() for _ in range(count)]
            is_bigendian = bool(read.byte())
            point_step, _row_step = read.words("<II")
            data = read.block()
        except struct.error as error:
            raise CloudError(f"cloud of {len(cdr)} bytes is cut off") from error
        message = SimpleNamespace(
            fields=fields, is_bigendian=is_bigendian, point_step=point_step, data=data
        )
        return cls(sec * 1_000_000_000 + nanosec, frame_id, cloud_of(message))


class _Reader:
    """Takes one thing after the other; alignment counts from after the encapsulation."""

    def __init__(self, body: memoryview) -> None:
        self._body = body
        self._at = 0

    def byte(self) -> int:
        self._at += 1
        return int(struct.unpack_from("B", self._body, self._at - 1)[0])

    def words(self, layout: str) -> tuple[int, ...]:
        """Integers of four bytes."""
        at = -(-self._at // 4) * 4
        found = struct.unpack_from(layout, self._body, at)
        self._at = at + 4 * len(found)
        return found

    def block(self) -> memoryview:
        """Bytes, after their number."""
        (size,) = self.words("<I")
        found = self._body[self._at : self._at + size]
        if len(found) != size:
            raise struct.error
        self._at += size
        return found

    def text(self) -> str:
        return bytes(self.block()).rstrip(b"\0").decode("utf-8", "replace")

    def field(self) -> SimpleNamespace:
        """A `sensor_msgs/msg/PointField`."""
        name = self.text()
        (offset,), datatype, (count,) = self.words("<I"), self.byte(), self.words("<I")
        return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)
