"""From transfers' events to packets of a bounded time and size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from roller_core.events import EventArray


@dataclass(frozen=True, slots=True)
class EventPart:
    """Events that go out as one message."""

    #: In order of time; sensor time, ns.
    events: EventArray
    #: When the host had the first of them, ns.
    arrival_ns: int

    @property
    def time_base_ns(self) -> int:
        """Sensor time of the first event, ns."""
        return int(self.events.t_ns[0])


class Packetiser:
    """Cuts the stream into parts no longer than `span_ns` and no larger than `max_events`.

    A part also ends where time steps back, as after the sensor's clock was set again, and with the
    transfer once the host has held its first event for `span_ns`.

    Parameters
    ----------
    span_ns : int
        Longest time from the first to the last event, ns.
    max_events : int
        Most events.
    emit : callable
        Takes each part; it owns the arrays.
    """

    def __init__(self, span_ns: int, max_events: int, emit: Callable[[EventPart], None]) -> None:
        self._span_ns = max(int(span_ns), 1)
        self._max_events = max(int(max_events), 1)
        self._emit = emit
        self._parts: list[EventArray] = []
        self._count = 0
        self._first_ns = 0
        self._last_ns = 0
        self._arrival_ns = 0

    def add(self, events: EventArray, arrival_ns: int) -> None:
        """Take the events of a transfer that arrived at `arrival_ns`."""
        back = np.flatnonzero(np.diff(events.t_ns) < 0) + 1
        begin = 0
        for end in (*back.tolist(), len(events)):
            if end > begin:
                self._add_in_order(events[begin:end], arrival_ns)
            begin = end
        if self._parts and arrival_ns - self._arrival_ns >= self._span_ns:
            self.flush()

    def tick(self, now_ns: int) -> None:
        """Send what has waited for `span_ns`, when no transfer came."""
        if self._parts and now_ns - self._arrival_ns >= self._span_ns:
            self.flush()

    def flush(self) -> None:
        """Send what there is."""
        if self._parts:
            self._emit(EventPart(EventArray.concatenate(self._parts), self._arrival_ns))
            self._parts = []
            self._count = 0

    def _add_in_order(self, events: EventArray, arrival_ns: int) -> None:
        if self._parts and int(events.t_ns[0]) < self._last_ns:
            self.flush()
        begin = 0
        while begin < len(events):
            if not self._parts:
                self._first_ns = int(events.t_ns[begin])
                self._arrival_ns = arrival_ns
            last = int(np.searchsorted(events.t_ns, self._first_ns + self._span_ns))
            end = min(last, begin + self._max_events - self._count)
            if end > begin:
                part = events[begin:end]
                # The decoder uses its arrays again for the next transfer.
                self._parts.append(
                    EventArray(part.x.copy(), part.y.copy(), part.t_ns.copy(), part.p.copy())
                )
                self._count += end - begin
                self._last_ns = int(part.t_ns[-1])
                begin = end
            if begin < len(events):
                self.flush()
