"""Cutting the stream of events into windows, by time or by travel of the sensor.

Where a window ends depends on the events and poses alone, never on when they arrived, so a
replay cuts where the live graph did.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.errors import RollerError
from roller_core.event_queue import EventCutter
from roller_core.events import EventArray
from roller_core.outputs import CONTACT, Output, Result, ScanFault
from roller_core.passes import REST_M
from roller_core.pose_track import PoseError, PoseTrack
from roller_core.transforms import F64
from roller_core.window_account import WindowAccount

from .depth_settings import DepthSettings
from .window_ends import LEAST_TRAVEL, WindowEnd, end_by_travel

#: Share of a window that the last one must have, by rule.
_LEAST_SHARE = {"travel": LEAST_TRAVEL, "time": 0.5}
#: A robot's poses lie off its path by about so much, m: who lets less pass loses all events.
_POSES_ERR_M = 1e-5


@dataclass(frozen=True)
class Window:
    """Events from `start_ns` (included) to `end_ns` (excluded), with poses all over."""

    start_ns: int
    end_ns: int
    events: EventArray


@dataclass(frozen=True)
class RefusedWindow:
    """A window that gives no depth, and why.

    `fault` is the error where the data are to blame (poses missing); a window that is only too
    short or without parallax has none. `contact`: skin and surface didn't move as one.
    """

    start_ns: int
    end_ns: int
    events: int
    reason: str
    fault: RollerError | None = None
    contact: bool = False

    @property
    def stamp_ns(self) -> int:
        """Middle of the window."""
        return (self.start_ns + self.end_ns) // 2

    @property
    def account(self) -> WindowAccount:
        """What was in the window, and why it gives nothing."""
        return WindowAccount(self.start_ns, self.end_ns, self.events, 0, lost=(self.reason,))

    def result(self, piece: str, gives: str, account: Output) -> Result:
        """What a stage gives for it: a notice, and to inspection why the scan isn't good there."""
        at_s = self.start_ns * 1e-9
        notice = f"{piece} at {at_s:.3f} s gives no {gives}: {self.reason}"
        told = ScanFault(self.reason, "contact" if self.contact else "data")
        fault = Output(CONTACT, self.end_ns, "", told)
        bad = self.contact or self.fault is not None
        return Result(self, (account, fault) if bad else (account,), notice)


class WindowCutter(EventCutter):
    """Holds events until their window is complete and covered by poses.

    Parameters
    ----------
    settings : DepthSettings
        Window rule, length, overlap and limits.
    track : PoseTrack
        Camera in base; grows while windows are cut.
    """

    def __init__(self, settings: DepthSettings, track: PoseTrack) -> None:
        super().__init__(settings.max_waiting_events, track)
        self._settings = settings
        self._start_ns: int | None = None
        #: Whether the last window was of a printed texture: the next ones are shorter.
        self.textured = False
        # What the end by travel was last looked for with, and what was found.
        self._travel_of = (0, 0)
        self._travel = WindowEnd(None, 0, 0.0)
        #: Whether the last window ended where the sensor came to rest; and the place.
        self.at_rest = False
        self._rested_at: F64 | None = None
        #: Of the last window's events, those that the one before had too.
        self.repeated = 0
        self._taken_to_ns = -(2**62)
        #: Windows without all of their events, because there was no keeping up.
        self.left_out = 0

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed; None while it isn't known."""
        return self._start_ns

    def cut(self, flush: bool = False) -> Window | RefusedWindow | None:
        """The next window, or None while it is not complete.

        Parameters
        ----------
        flush : bool
            No more events will come: what is left makes up the last window.
        """
        while len(self._queue) and len(self._track):
            if not self._find_start(flush):
                return None
            start = self._start_ns
            assert start is not None
            found = self._find_end(start, flush)
            if found is None:
                return None
            end, following, reason, fault = found
            self.at_rest = self._travel.at_rest and end == self._travel.end_ns
            ramps = self.ramp_events
            window = self._take(start, end, following, placed=fault is None)
            if self._in_gap(start, end):
                self.left_out += 1
                continue
            if not len(window.events) and not reason:
                reason = self._too_near() if self.ramp_events > ramps else ""
                if not reason:
                    continue  # nothing happened; go on to the next
            try:
                self._track.check(start, end)
            except PoseError as error:
                reason, fault = str(error), error
            if reason and fault is None and self._still_there(end):
                self.still_events += len(window.events)
                continue  # a robot that stands after its scan is no fault
            self._rested_at = self._track.at(end).position if self.at_rest else None
            if reason:
                return RefusedWindow(start, end, len(window.events), reason, fault)
            return window
        return None

    def _too_near(self) -> str:
        """Why no event was left of a window, if the depth range is to blame."""
        if self.most_bend_m >= _POSES_ERR_M:
            return ""
        return (
            f"a pixel at depth_min_m = {self._settings.depth_min_m:g} is "
            f"{self.most_bend_m * 1e6:.2g} µm, finer than poses tell the path: no event has a "
            "place; set depth_min_m nearer to the surface"
        )

    def _still_there(self, t_ns: int) -> bool:
        """Whether the sensor is where it came to rest when the last window ended."""
        if self._rested_at is None:
            return False
        return bool(np.linalg.norm(self._track.at(t_ns).position - self._rested_at) < REST_M)

    def _find_start(self, flush: bool) -> bool:
        """Settle where the next window starts; False while it can't be known."""
        first_ns = self._queue.first_ns
        if self._start_ns is None:
            # Events from before the first pose can't be placed.
            if first_ns < self._track.start_ns:
                self._drop_unplaced(self._track.start_ns)
                if not len(self._queue):
                    return False
                first_ns = self._queue.first_ns
            self._start_ns = first_ns
        elif self._settings.window_rule == "time" and not self._gaps:  # those in it are counted
            length = self._length_ns()
            empty = (first_ns - self._start_ns) // length
            self._start_ns += max(empty, 0) * length
        if self._track.end_ns > self._start_ns:
            return True
        if flush:
            self._drop_unplaced()
        return False

    def _length_ns(self) -> int:
        return round(self._settings.window.time_s * 1e9)

    def _find_end(self, start: int, flush: bool) -> tuple[int, int, str, RollerError | None] | None:
        """End of the window, start of the one after, why it is refused, and whose fault it is."""
        s = self._settings
        # The newest pose tells how bent the way to the one before it was.
        track_end = int(self._track.times_ns[-1 if flush else -2])
        last = min(self._queue.newest_ns + 1, track_end)
        if s.window_rule == "all":
            return (last, last, "", None) if flush and last > start else None
        if s.window_rule == "time":
            end = start + self._length_ns()
            following = start + round(self._length_ns() * (1 - s.window_overlap))
            found = WindowEnd(end, following, (last - start) / self._length_ns())
        else:
            known = start, self._track.end_ns
            if flush or self._travel_of != known:  # packets come more often than poses
                self._travel_of, self._travel = known, self._travel_end(start, last)
            found = self._travel
        end = found.end_ns if found.end_ns is not None else 2**63 - 1
        if end <= track_end and end <= self._queue.newest_ns:
            return end, found.following_ns, found.reason, found.fault
        if not flush:
            return None
        if last <= start:
            self._drop_unplaced()
            return None
        if end <= track_end and end <= last:
            return end, found.following_ns, found.reason, found.fault
        if found.fault is not None and found.end_ns is None:
            return last, 2**63 - 1, found.reason, found.fault
        enough = found.share >= _LEAST_SHARE[s.window_rule]
        short = "" if enough else f"the last {found.share:.0%} of a window is too short"
        return last, 2**63 - 1, short, None

    def _travel_end(self, start: int, last: int) -> WindowEnd:
        """Where a window by travel ends."""
        s = self._settings
        return end_by_travel(
            self._track, start, last, *s.travel_and_step_m(self.textured), s.max_still_s
        )

    def _take(self, start: int, end: int, following: int, placed: bool) -> Window:
        """Take the window's events and forget all before the window that follows.

        Those of wrong poses aren't `placed`: what they say of pixels is as wrong.
        """
        self._queue.drop_before(start)
        taken = self._queue.first(self._queue.count_before(end))
        if following < 2**62:
            self._start_ns = following
            self._queue.drop_before(following)
        else:
            self._start_ns = None
            self._queue.drop_before(end)
            self._drop_unplaced()
        events = self._placed(taken, start, end) if placed else taken
        self.repeated = int(np.searchsorted(events.t_ns, self._taken_to_ns))
        # A window that ends at a gap may end before the one before it.
        taken_to = max(self._taken_to_ns, end)
        self._taken_to_ns = taken_to if self._start_ns is not None else -(2**62)
        return Window(start, end, events)
