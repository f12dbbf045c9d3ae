"""Events in order of time over packets: late ones left out, a source that starts anew noticed."""

from __future__ import annotations

import numpy as np

from .errors import RollerError
from .events import EventArray

#: Events up to this late are jitter, of a clock's map or of threads, ns; of packets in the wrong
#: order more than so much is told.
JITTER_NS, _TOLD_NS = 5_000_000, 500_000
#: Events later than this belong to a source that started anew, ns; of one whose numbers began anew,
#: such as a recording that is played again, all that are no jitter.
_RESTART_NS = 1_000_000_000


class TimeBackwardsError(RollerError):
    """Time jumped back: the source started anew, or its clock was set back.

    `events` are those of the packet that showed it, the first of the new start.
    """

    def __init__(self, message: str, events: EventArray) -> None:
        super().__init__(message)
        self.events = events


class TimeOrder:
    """Keeps events from going back in time.

    Attributes
    ----------
    last_ns : int or None
        Time of the newest event; None before the first.
    late_events : int
        Events left out because newer ones came first; and those, half a millisecond late or more,
        of packets in the wrong order, which take the time of the newest up to 5 ms.
    """

    def __init__(self) -> None:
        self.last_ns: int | None = None
        self.late_events = 0

    def take(self, events: EventArray, renumbered: bool = False, late: bool = False) -> EventArray:
        """Events of the next packet, in order of time, none of them before those of earlier ones.

        Parameters
        ----------
        events : EventArray
            The packet's.
        renumbered : bool
            Whether the packets' numbers begin anew with it.
        late : bool
            Whether its number says that it came after later ones.

        Raises
        ------
        TimeBackwardsError
            If time jumped back by more than a second, or with the packets' numbers; the order then
            begins anew.
        """
        last = self.last_ns
        if last is not None and len(events) and events.t_ns[0] < last:
            behind_ns = last - int(events.t_ns[0])
            if behind_ns > (JITTER_NS if renumbered else _RESTART_NS):
                self.last_ns = int(events.t_ns[-1])
                raise TimeBackwardsError(
                    f"event time runs backwards by {behind_ns * 1e-9:.3f} s, "
                    f"from {last * 1e-9:.6f} s; was the recording or the driver started anew?",
                    events,
                )
            if behind_ns < JITTER_NS:
                if renumbered or late:
                    self.late_events += int(np.searchsorted(events.t_ns, last - _TOLD_NS))
                events = events.with_times(np.maximum(events.t_ns, last))
            else:
                kept = events[int(np.searchsorted(events.t_ns, last)) :]
                self.late_events += len(events) - len(kept)
                events = kept
        if len(events):
            self.last_ns = int(events.t_ns[-1])
        return events
