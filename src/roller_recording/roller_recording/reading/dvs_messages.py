"""Events of older drivers, `dvs_msgs/EventArray`, as event packets.

The type holds a header, height, width and a list of events (x, y, ROS time, polarity). Its times
are ROS time already, so the packet's stamp is the first event's time.
"""

from __future__ import annotations

import struct
from collections import Counter

import numpy as np
import numpy.typing as npt

from roller_core.bags import EVENT_PACKET, typestore
from roller_core.codecs import encode
from roller_core.events import EventArray

DVS_ARRAY = "dvs_msgs/msg/EventArray"
#: ROS 1 packs events.
_PACKED = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("p", "u1")])
#: CDR aligns their times to four bytes: an event's x stands at the end of the one before.
_ALIGNED = np.dtype(
    {"names": ["y", "sec", "nsec", "p", "next_x"], "formats": ["<u2", "<u4", "<u4", "u1", "<u2"],
     "offsets": [0, 4, 8, 12, 14], "itemsize": 16}
)  # fmt: skip


class DvsPackets:
    """Makes event packets in CDR; numbers those of each topic."""

    def __init__(self) -> None:
        self._store = typestore()
        self._numbers: Counter[str] = Counter()

    def from_ros1(self, topic: str, raw: bytes | memoryview) -> bytes:
        """A message as ROS 1 serializes it.

        Raises
        ------
        ValueError, struct.error
            If it is malformed.
        """
        (length,) = struct.unpack_from("<12xI", raw)
        frame = bytes(raw[16 : 16 + length]).decode()
        height, width, count = struct.unpack_from("<III", raw, 16 + length)
        rows = np.frombuffer(raw, _PACKED, count, 28 + length)
        return self._packet(topic, frame, height, width, rows["x"], rows["y"], rows)

    def from_cdr(self, topic: str, data: bytes) -> bytes:
        """A message as ROS 2 serializes it, little-endian.

        Raises
        ------
        ValueError, struct.error
            If it is malformed.
        """
        body = memoryview(data)[4:]
        (length,) = struct.unpack_from("<8xI", body)
        frame = bytes(body[12 : 12 + length]).rstrip(b"\0").decode()
        start = -(-(12 + length) // 4) * 4
        height, width, count = struct.unpack_from("<III", body, start)
        found = np.frombuffer(body, np.uint8, max(16 * count - 3, 0), start + 12)
        rows = np.resize(found, 16 * count).view(_ALIGNED)
        x, y = np.roll(rows["next_x"], 1), rows["y"].copy()
        if count:  # the first stands at the beginning
            x[0], y[0] = struct.unpack_from("<HH", body, start + 12)
        return self._packet(topic, frame, height, width, x, y, rows)

    def _packet(
        self, topic: str, frame: str, height: int, width: int,
        x: npt.NDArray[np.uint16], y: npt.NDArray[np.uint16], rows: npt.NDArray[np.void],
    ) -> bytes:  # fmt: skip
        t_ns = rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nsec"]
        events = EventArray.from_arrays(x, y, t_ns, rows["p"] > 0).sorted_by_time()
        first_ns = int(events.t_ns[0]) if len(events) else 0
        types = self._store.types
        stamp = types["builtin_interfaces/msg/Time"](*divmod(first_ns, 1_000_000_000))
        message = types[EVENT_PACKET](
            header=types["std_msgs/msg/Header"](stamp, frame),
            height=height,
            width=width,
            seq=self._numbers[topic],
            time_base=first_ns,
            encoding="mono",
            is_bigendian=False,
            events=encode("mono", events, first_ns),
        )
        self._numbers[topic] += 1
        return bytes(self._store.serialize_cdr(message, EVENT_PACKET))
