"""A queue that is bounded in bytes."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable

from roller_recording.raw_message import RawMessage

#: What a message costs beside its data, bytes; about what the objects around it take.
_OVERHEAD = 200
#: Messages up to this size may take a tenth more than the limit: poses and calibration are small,
#: and a bag without them is worth little.
_SMALL = 16_384


class ByteQueue:
    """Messages that wait to be written.

    Parameters
    ----------
    limit_bytes : int
        Most that may wait. What comes when it is full is turned away, so that what is in the
        bag stays without holes as long as it goes.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._items: deque[RawMessage] = deque()
        self._bytes = 0
        self._closed = False
        self._ready = threading.Condition()

    @property
    def waiting_bytes(self) -> int:
        """Bytes that wait."""
        return self._bytes

    @property
    def waiting(self) -> int:
        """Messages that wait."""
        return len(self._items)

    def put(self, messages: Iterable[RawMessage]) -> list[RawMessage]:
        """Queue messages; those for which there is no room are given back."""
        refused = []
        with self._ready:
            for message in messages:
                size = len(message.data) + _OVERHEAD
                room = self._limit * 1.1 if size <= _SMALL else self._limit
                if self._closed or self._bytes + size > room:
                    refused.append(message)
                    continue
                self._items.append(message)
                self._bytes += size
            self._ready.notify()
        return refused

    def get(self, timeout_s: float) -> RawMessage | None:
        """The next message; None if none came in time."""
        with self._ready:
            if not self._items and not self._closed:
                self._ready.wait(timeout_s)
            if not self._items:
                return None
            message = self._items.popleft()
            self._bytes -= len(message.data) + _OVERHEAD
            return message

    @property
    def finished(self) -> bool:
        """Whether nothing waits and nothing more comes."""
        return self._closed and not self._items

    def close(self) -> None:
        """Take no more."""
        with self._ready:
            self._closed = True
            self._ready.notify()

    def clear(self) -> list[RawMessage]:
        """Take out everything that waits."""
        with self._ready:
            rest = list(self._items)
            self._items.clear()
            self._bytes = 0
            return rest
