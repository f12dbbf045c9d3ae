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
from roller_core.passes import REST_M, rest_begin
from roller_core.pose_track import PoseError, PoseTrack
from roller_core.transforms import F64
from roller_core.window_account import WindowAccount

from .depth_settings import DepthSettings

#: Share of a window that the last one must have, by rule: travel that short gives a depth still.
_LEAST_SHARE = {"travel": 0.4, "time": 0.5}
#: Share of a window by travel from which it ends where the sensor turns back: what windows under a
#: printed texture repeat. One that comes back by so much, m, has turned.
_TURN_SHARE, _TURNED_M = 0.25, 1e-3


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
        self._travel: tuple[int | None, int, float, str] = (None, 0, 0.0, "")
        self._rest_ns: int | None = None  # where that end is, if the sensor came to rest there
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
            end, following, reason = found
            self.at_rest = end == self._rest_ns
            window = self._take(start, end, following)
            if self._in_gap(start, end):
                self.left_out += 1
                continue
            if not len(window.events) and not reason:
                continue  # nothing happened; go on to the next
            fault = None
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

    def _find_end(self, start: int, flush: bool) -> tuple[int, int, str] | None:
        """End of the window, start of the one after, and why it is refused, if it is."""
        s = self._settings
        # The newest pose tells how bent the way to the one before it was.
        track_end = int(self._track.times_ns[-1 if flush else -2])
        last = min(self._queue.newest_ns + 1, track_end)
        if s.window_rule == "all":
            return (last, last, "") if flush and last > start else None
        if s.window_rule == "time":
            end = start + self._length_ns()
            following = start + round(self._length_ns() * (1 - s.window_overlap))
            share = (last - start) / self._length_ns()
            reason = ""
        else:
            known = start, self._track.end_ns
            if flush or self._travel_of != known:  # packets come more often than poses
                self._travel_of, self._travel = known, self._travel_end(start, last)
            end_or_none, following, share, reason = self._travel
            end = end_or_none if end_or_none is not None else 2**63 - 1
        if end <= track_end and end <= self._queue.newest_ns:
            return end, following, reason
        if not flush:
            return None
        if last <= start:
            self._drop_unplaced()
            return None
        if end <= track_end and end <= last:
            return end, following, reason
        enough = share >= _LEAST_SHARE[s.window_rule]
        short = "" if enough else f"the last {share:.0%} of a window is too short"
        return last, 2**63 - 1, short

    def _travel_end(self, start: int, last: int) -> tuple[int | None, int, float, str]:
        """End, following start, share reached and refusal of a window by travel."""
        s = self._settings
        self._rest_ns = None
        travel_m, step_m = s.travel_and_step_m(self.textured)
        limit = start + round(s.max_still_s * 1e9)
        try:
            origin = self._track.at(start).position
        except PoseError as error:
            # A gap: restart at the first pose after it.
            times = self._track.times_ns
            later = times[np.searchsorted(times, start, side="right") :]
            return int(later[0]), int(later[0]), 0.0, str(error)
        times = self._track.times_ns
        first = int(np.searchsorted(times, start, side="right"))
        times = times[first:]
        away = np.linalg.norm(self._track.positions[first:] - origin, axis=1)
        end = self._reach(start, times, away, travel_m)
        # A scan may end here. Noise goes on, so that no lack of events tells that it did.
        rest = self._rest_after(times, away, _LEAST_SHARE["travel"] * travel_m)
        if rest is not None and rest <= limit and (end is None or rest < end):
            self._rest_ns = rest
            return rest, rest, 1.0, ""
        # What both ways show of a wall isn't in one place: pixels are late on either side of it.
        turn = self._turn_after(times, away, _TURN_SHARE * travel_m)
        if turn is not None and turn <= limit and (end is None or turn < end):
            return turn, turn, 1.0, ""
        if end is not None and end <= limit:
            following = self._reach(start, times, away, step_m) if step_m < travel_m else end
            return end, following or end, 1.0, ""
        if self._track.end_ns >= limit:
            return (
                limit,
                limit,
                0.0,
                (
                    f"the sensor moved less than {travel_m * 1e3:g} mm "
                    f"in {s.max_still_s:g} s: no parallax, no depth"
                ),
            )
        within = away[times <= last]
        return None, limit, float(within.max() / travel_m) if len(within) else 0.0, ""

    def _rest_after(self, times: np.ndarray, away: np.ndarray, travel: float) -> int | None:
        """Time at which the sensor came to rest after it was a distance from the start."""
        far = np.flatnonzero(away >= travel)
        if not len(far):
            return None
        k = rest_begin(times[far[0] :], self._track.positions[-len(times) + far[0] :])
        return int(times[far[0] + k]) if k is not None else None

    @staticmethod
    def _turn_after(times: np.ndarray, away: np.ndarray, travel: float) -> int | None:
        """Time at which the sensor turned back after it was a distance from the start."""
        farthest = np.maximum.accumulate(away)
        back = np.flatnonzero((farthest >= travel) & (away < farthest - _TURNED_M))
        return int(times[np.argmax(away[: back[0]])]) if len(back) else None

    @staticmethod
    def _reach(start: int, times: np.ndarray, away: np.ndarray, travel: float) -> int | None:
        """Time at which the distance from the start first reaches `travel`."""
        reached = np.flatnonzero(away >= travel)
        if not len(reached):
            return None
        k = int(reached[0])
        t0, d0 = (start, 0.0) if k == 0 else (int(times[k - 1]), float(away[k - 1]))
        share = (travel - d0) / (float(away[k]) - d0)
        return t0 + max(round(share * (int(times[k]) - t0)), 1)

    def _take(self, start: int, end: int, following: int) -> Window:
        """Take the window's events and forget all before the window that follows."""
        self._queue.drop_before(start)
        taken = self._queue.first(self._queue.count_before(end))
        if following < 2**62:
            self._start_ns = following
            self._queue.drop_before(following)
        else:
            self._start_ns = None
            self._queue.drop_before(end)
            self._drop_unplaced()
        events = self._placed(taken, start, end)
        self.repeated = int(np.searchsorted(events.t_ns, self._taken_to_ns))
        # A window that ends at a gap may end before the one before it.
        taken_to = max(self._taken_to_ns, end)
        self._taken_to_ns = taken_to if self._start_ns is not None else -(2**62)
        return Window(start, end, events)
