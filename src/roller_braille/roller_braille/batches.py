"""Cutting the stream of events into the batches that are warped together.

A batch ends after a number of events or a travel of the sensor, where a pass ends, or where events
were left out: all decided by events and poses, never by when they arrived.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.event_queue import EventCutter
from roller_core.events import EventArray
from roller_core.passes import Pass, RollTracker, Span
from roller_core.pose_track import PoseTrack

from .reader_settings import BrailleSettings

#: Most events of a batch (paper: 20 000), and the travel of the sensor that ends one too, m.
_MOST_EVENTS, _TRAVEL_M = 100_000, 0.0015


@dataclass(frozen=True)
class Batch:
    """Events of a rolling sensor, from `start_ns` (included) to `end_ns` (excluded)."""

    roll: Pass
    start_ns: int
    end_ns: int
    events: EventArray


@dataclass(frozen=True)
class PassEnd:
    """The pass is over."""

    roll: Pass


class BatchCutter(EventCutter):
    """Holds events until their batch is complete and covered by poses.

    Parameters
    ----------
    settings : BrailleSettings
        Limits.
    track : PoseTrack
        Camera in base; grows while batches are cut.
    """

    def __init__(self, settings: BrailleSettings, track: PoseTrack) -> None:
        super().__init__(settings.max_waiting_events, track)
        self._rolls = RollTracker(track)
        self._span: Span | None = None
        self._start_ns = 0
        # What the batch's end was last found for, and where it is.
        self._limit_of: tuple[int, int, int, bool] | None = None
        self._limit_ns: int | None = None

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed; None while it isn't known."""
        known = self._rolls.known_ns
        if known is None:
            return None
        if self._span is not None:
            return min(known, self._start_ns)
        return min([known, *(s.start_ns for s in self._rolls.spans)])

    def cut(self, flush: bool = False) -> Batch | PassEnd | None:
        """The next batch or end of a pass, or None while there is none complete.

        Parameters
        ----------
        flush : bool
            No more events will come: what is left makes up the last batch.
        """
        self._rolls.update()
        if self._rolls.known_ns is None:
            return None
        if flush:
            self._rolls.stop()
        while True:
            if self._span is None and not self._next_span(flush):
                return None
            assert self._span is not None
            span = self._span
            if span.last_of_pass:
                self._span = None
                return PassEnd(span.roll)
            batch = self._cut_span(span, flush)
            if batch is not None:
                return batch
            if self._span is not None:
                return None

    def _next_span(self, flush: bool) -> bool:
        known = self._rolls.known_ns
        assert known is not None
        if not self._rolls.spans:
            self._skip(known)
            if flush:
                self._drop_unplaced()
            return False
        self._span = self._rolls.spans.popleft()
        self._start_ns = self._span.start_ns
        if not self._span.last_of_pass:
            self._skip(self._start_ns)
        return True

    def _skip(self, t_ns: int) -> None:
        """Pass over the events of a sensor that doesn't roll."""
        self._drop_unplaced(min(t_ns, self._track.start_ns))
        gaps = self._rolls.gaps
        while gaps and gaps[0][0] < t_ns:
            self.still_events += self._queue.drop_before(gaps[0][0])
            self._drop_unplaced(min(gaps[0][1], t_ns))
            if gaps[0][1] > t_ns:
                break
            gaps.popleft()
        self.still_events += self._queue.drop_before(t_ns)

    def _cut_span(self, span: Span, flush: bool) -> Batch | None:
        """The next batch of a span; the span is done when it has none left."""
        first = self._track.start_ns
        if self._start_ns < first:  # poses that no event came for are gone
            self._drop_unplaced(first)
            self._start_ns = first
        self._gaps = sorted(gap for gap in self._gaps if gap[1] > self._start_ns)
        hole = self._gaps[0] if self._gaps else None
        if hole is not None and hole[0] < self._start_ns:  # go on after it
            self._start_ns = min(hole[1], span.end_ns)
            hole = self._gaps[1] if len(self._gaps) > 1 else None
        if self._start_ns >= span.end_ns:
            if not span.open:
                self._span = None
            return None
        # Where poses come ahead of events, those of the time before it are still to come.
        self.still_events += self._queue.drop_before(self._start_ns)
        limit = self._limit(span)
        if hole is not None and (limit is None or hole[0] < limit):
            limit = hole[0] + 1
        passed = limit is not None and (self._queue.newest_ns >= limit or flush)
        if not passed and len(self._queue) < _MOST_EVENTS:
            return None
        until = span.end_ns if limit is None else limit
        count = min(self._queue.count_before(until), _MOST_EVENTS)
        if count == _MOST_EVENTS:
            end = self._queue.time_of(count - 1)
        elif limit is not None and passed:
            end = limit
        else:
            return None
        start, self._start_ns = self._start_ns, end
        return Batch(span.roll, start, end, self._queue.take(count))

    def _limit(self, span: Span) -> int | None:
        """Where the batch ends by travel or with its span; None while that isn't known."""
        known = (self._start_ns, span.end_ns, self._track.end_ns, span.open)
        if self._limit_of != known:
            self._limit_of, self._limit_ns = known, self._find_limit(span)
        return self._limit_ns

    def _find_limit(self, span: Span) -> int | None:
        times = self._track.times_ns
        a = int(np.searchsorted(times, self._start_ns, side="right"))
        b = int(np.searchsorted(times, span.end_ns, side="right"))
        before = max(a - 1, 0)
        along = self._track.positions[before:b] @ span.roll.rotation[:, 0]
        clock = (times[before:b] - self._start_ns).astype(np.float64)
        away = along[a - before :] - np.interp(0.0, clock, along)
        reached = np.flatnonzero(np.abs(away) >= _TRAVEL_M)
        if len(reached):
            return int(times[a + reached[0]])
        return None if span.open else span.end_ns
