"""Event packets that came before the camera's calibration."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

#: Bytes of a packet beside its events, about.
PACKET_BYTES = 500


class EarlyPackets:
    """Packets in order of arrival; beyond a limit the oldest go.

    Parameters
    ----------
    most_bytes : float
        The limit; the newest packet stays whatever its size.
    """

    def __init__(self, most_bytes: float) -> None:
        self._most_bytes = most_bytes
        #: None where packets of another source follow.
        self._packets: deque[Any] = deque()
        self._bytes = 0

    def add(self, packet: Any) -> int:
        """Keep a packet; say how many older ones had to go for it."""
        self._packets.append(packet)
        self._bytes += len(packet.events) + PACKET_BYTES
        gone = 0
        while self._bytes > self._most_bytes and len(self._packets) > 1:
            oldest = self._packets.popleft()
            if oldest is not None:
                self._bytes -= len(oldest.events) + PACKET_BYTES
                gone += 1
        return gone

    def new_source(self) -> None:
        """Packets of another source follow."""
        self._packets.append(None)

    def take_all(self) -> Iterator[Any]:
        """Packets, and None where the source changed; each is gone once it was given."""
        self._bytes = 0
        while self._packets:
            yield self._packets.popleft()
