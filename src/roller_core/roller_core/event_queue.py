"""Events that wait for what they belong to, in order of time, up to a limit."""

from __future__ import annotations

from collections import deque

import numpy as np

from .events import EventArray

#: Before any event.
_NEVER_NS = -(2**62)


class EventQueue:
    """Events in order of time; beyond the limit the oldest go, counted.

    Parameters
    ----------
    most_events : int
        Events that may wait. What came last always stays.

    Attributes
    ----------
    dropped : int
        Events that went because of the limit.
    newest_ns : int
        Time of the newest event ever added; far in the past before the first.
    """

    def __init__(self, most_events: int) -> None:
        self._most = most_events
        self._parts: deque[EventArray] = deque()
        self._count = 0
        self.dropped = 0
        self.newest_ns = _NEVER_NS

    def __len__(self) -> int:
        """Events that wait."""
        return self._count

    @property
    def first_ns(self) -> int:
        """Time of the oldest event; IndexError if there is none."""
        return int(self._parts[0].t_ns[0])

    def add(self, events: EventArray) -> None:
        """Take events, none older than those before."""
        if not len(events):
            return
        self._parts.append(events)
        self._count += len(events)
        self.newest_ns = int(events.t_ns[-1])
        while self._count > self._most and len(self._parts) > 1:
            gone = self._parts.popleft()
            self._count -= len(gone)
            self.dropped += len(gone)

    def count_before(self, t_ns: int) -> int:
        """Events before a time."""
        count = 0
        for part in self._parts:
            k = int(np.searchsorted(part.t_ns, t_ns))
            count += k
            if k < len(part):
                break
        return count

    def time_of(self, number: int) -> int:
        """Time of an event that waits, counted from the oldest, 0.

        Raises
        ------
        IndexError
            If fewer wait.
        """
        for part in self._parts:
            if number < len(part):
                return int(part.t_ns[number])
            number -= len(part)
        raise IndexError("fewer events wait")

    def first(self, count: int) -> EventArray:
        """The oldest events; they stay."""
        found: list[EventArray] = []
        for part in self._parts:
            if count <= 0:
                break
            found.append(part if len(part) <= count else part[:count])
            count -= len(part)
        return EventArray.concatenate(found)

    def take(self, count: int) -> EventArray:
        """The oldest events; they go."""
        found = self.first(count)
        self.drop(len(found))
        return found

    def drop_before(self, t_ns: int) -> int:
        """Forget events before a time; how many."""
        count = self.count_before(t_ns)
        self.drop(count)
        return count

    def drop(self, count: int) -> None:
        """Forget the oldest events."""
        self._count -= count
        while count:
            part = self._parts[0]
            if len(part) <= count:
                count -= len(part)
                self._parts.popleft()
            else:
                self._parts[0] = part[count:]
                count = 0
