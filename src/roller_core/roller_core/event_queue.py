"""Events that wait for their poses, in order of time, up to a limit; and what became of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque

import numpy as np

from .dead_time import DeadTime
from .events import EventArray, EventArrayError
from .pose_track import PoseTrack
from .waiting_events import WaitingEvents, joined

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
        self._parts: deque[WaitingEvents] = deque()
        self._count = 0
        self.dropped = 0
        self.newest_ns = _NEVER_NS

    def __len__(self) -> int:
        """Events that wait."""
        return self._count

    @property
    def first_ns(self) -> int:
        """Time of the oldest event; IndexError if there is none."""
        return self._parts[0].time_of(0)

    def add(self, events: EventArray) -> None:
        """Take events in order of time.

        Raises
        ------
        EventArrayError
            If they begin before the newest that was ever added.
        """
        if not len(events):
            return
        if events.t_ns[0] < self.newest_ns:
            behind_s = (self.newest_ns - int(events.t_ns[0])) * 1e-9
            raise EventArrayError(
                f"events begin {behind_s:.6f} s before the newest of those that came before; "
                "expected events in order of time"
            )
        self._parts.append(WaitingEvents.of(events))
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
            if part.time_of(-1) >= t_ns:
                return count + part.count_before(t_ns)
            count += len(part)
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
                return part.time_of(number)
            number -= len(part)
        raise IndexError("fewer events wait")

    def first(self, count: int) -> EventArray:
        """The oldest events; they stay."""
        found: list[WaitingEvents] = []
        for part in self._parts:
            if count <= 0:
                break
            found.append(part if len(part) <= count else part[:count])
            count -= len(part)
        return joined(found)

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

    def clear(self) -> int:
        """Forget all events; how many."""
        count = self._count
        self.drop(count)
        return count


class EventCutter(ABC):
    """Base of what cuts a stream of events up by poses: events that wait, and counts of the rest.

    Parameters
    ----------
    most_events : int
        Events that may wait; beyond it the oldest are dropped.
    track : PoseTrack
        Camera in base; grows while events are cut.

    Attributes
    ----------
    events_without_pose : int
        Events that no pose was there for.
    still_events : int
        Events of a sensor that didn't move.
    ramp_events : int
        Events of a sensor that accelerated harder than its poses can tell, left out.
    """

    #: Error of a place between two poses that is let pass, metres.
    most_bend_m = np.inf
    #: Leaves out what pixels tell too late; None leaves all.
    dead_time: DeadTime | None = None
    #: Whether events are known to be of a printed texture, where all stay; see `DeadTime.textured`.
    textured = False

    def __init__(self, most_events: int, track: PoseTrack) -> None:
        self._queue = EventQueue(most_events)
        self._track = track
        self._gaps: list[tuple[int, int]] = []
        self._gap_begun = False
        self.events_without_pose = 0
        self.still_events = 0
        self.ramp_events = 0
        self._ramps_to_ns = -(2**62)

    @property
    def held_events(self) -> int:
        """Events that wait."""
        return len(self._queue)

    @property
    def dropped_events(self) -> int:
        """Events beyond the backlog's limit."""
        return self._queue.dropped

    @property
    @abstractmethod
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed; None while it isn't known."""

    def add(self, events: EventArray) -> None:
        """Take events in order of time; beyond the backlog's limit the oldest go, counted."""
        if self._gap_begun and len(events):
            self._gaps.append((self._queue.newest_ns, int(events.t_ns[0])))
            self._gap_begun = False
        dropped, oldest_ns = self._queue.dropped, self._queue.first_ns if len(self._queue) else 0
        self._queue.add(events)
        if self._queue.dropped > dropped:
            begun = [gap for gap in self._gaps if gap[1] == oldest_ns]
            self._gaps = [gap for gap in self._gaps if gap[1] != oldest_ns]
            self._gaps.append((min([oldest_ns, *(a for a, _ in begun)]), self._queue.first_ns))

    def leave_gap(self) -> None:
        """Between the events before and those after, some were left out on purpose."""
        self._gap_begun = True

    def _placed(self, events: EventArray, start_ns: int, end_ns: int) -> EventArray:
        """Events of a span without those whose place is uncertain; counted."""
        late = self.dead_time
        if late and self.textured:
            late.blind_m = 0.0
        elif late and late.measure(events) and self._track.covers(start_ns, end_ns):
            begin, end = self._track.matrices([start_ns, end_ns])[:, :3, 3]
            travel_m = float(np.linalg.norm(end - begin))
            events = self._without_late(events, travel_m, end_ns - start_ns)
        return self._without_ramps(events, start_ns, end_ns)

    def _without_late(self, events: EventArray, travel_m: float, span_ns: int) -> EventArray:
        """Events that were measured, without those that pixels tell too late."""
        late = self.dead_time
        if late is None or not late.ns or late.textured(events, travel_m):
            return events
        return late.without_followers(events, travel_m / max(span_ns, 1) * 1e9)

    def _without_ramps(self, events: EventArray, start_ns: int, end_ns: int) -> EventArray:
        """Events without those of ramps that are too steep for the poses; counted."""
        ramps = self._track.bent(start_ns, end_ns, self.most_bend_m) if len(events) else []
        if not ramps:
            return events
        keep = np.ones(len(events), np.bool_)
        for begin, end in ramps:
            keep[slice(*np.searchsorted(events.t_ns, (begin, end)))] = False
        # Windows may overlap: each is counted once.
        self.ramp_events += int((~keep & (events.t_ns >= self._ramps_to_ns)).sum())
        self._ramps_to_ns = max(self._ramps_to_ns, end_ns)
        return events[keep]

    def _in_gap(self, start_ns: int, end_ns: int) -> bool:
        """Whether events were left out in a span; the spans asked for go on in time."""
        self._gaps = [gap for gap in self._gaps if gap[1] >= start_ns]
        return any(a < end_ns for a, _ in self._gaps)

    def _drop_unplaced(self, before_ns: int | None = None) -> None:
        """Forget events that no pose is there for: those before a time, or all."""
        gone = self._queue.clear() if before_ns is None else self._queue.drop_before(before_ns)
        self.events_without_pose += gone
