"""Which rows of a strip are done, cut into blocks: what no event reaches any more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .event_store import EventStore

#: Rows beyond a block's ends that its evidence reaches into, m.
MARGIN_M = 0.001
#: Lengths, side by side, that are one block if they hold together less than so many events, and the
#: next one less than so many: between what lies on a bare plate the work on a block hardly hangs on
#: its events, nor on its length. Where the sensor is fast more by row of the image, but fewer than
#: of a texture, as it has soon passed what a block waits for. There a block that holds more than
#: the last number takes in what holds less behind it, up to one length more: the end of what lies
#: on the plate, and bare plate.
_MOST_JOINED, _FEW_EVENTS, _FEW_FOR_FAST = 3, (8000, 8000, 0), (300, 5000, 16)
#: Time for a length from which on the sensor isn't fast, s.
_LONG_S = 0.03

Few = tuple[int, int, int]


@dataclass(frozen=True)
class Block:
    """Rows start_m ≤ x < end_m of a strip that no event reaches any more."""

    #: Its lengths, counted along the strip: the first one, and the one after the last.
    number: int
    end: int
    #: Lengths whose events reach its rows, its own among them.
    sources: tuple[int, ...]
    #: Rows, metres along the strip.
    start_m: float
    end_m: float
    #: Least and largest y of the events.
    low_y_m: float
    high_y_m: float
    #: Times of its first and last event.
    first_ns: int
    last_ns: int
    #: Its own; those that reach it from beside belong to the blocks beside.
    events: int


class BlockCutter:
    """Cuts the lengths of a strip into blocks, once they are out of view.

    Parameters
    ----------
    store : EventStore
        Events of the strip, by length.
    length_m : float
        A length, metres.
    rows : int
        Of the image.
    """

    def __init__(self, store: EventStore, length_m: float, rows: int) -> None:
        self._store = store
        self._length_m = length_m
        self._rows = rows
        self._reach_m = MARGIN_M
        self._done: int | None = None

    @property
    def _beside(self) -> int:
        """Lengths to either side from which events reach a block's rows."""
        return int(np.ceil(self._reach_m / self._length_m))

    def reach(self, reach_m: float) -> None:
        """Events reach rows so far from their own place, metres."""
        self._reach_m = max(self._reach_m, reach_m)

    def open_from(self, first: int) -> int:
        """The first length, of those from one on, whose events reach rows that aren't done."""
        return first if self._done is None else max(first, self._done + 1 - self._beside)

    def ready(self, behind_m: float, speed_m_s: float, flush: bool = False) -> list[Block]:
        """Blocks that no event reaches any more, in order.

        Parameters
        ----------
        behind_m : float
            Rows before it are out of view, metres along the strip.
        speed_m_s : float
            Of the sensor.
        flush : bool
            No more events will come: all rows are done.
        """
        beside = self._beside
        # Asked at every pose, of which hardly any takes a length out of view.
        if self._done is not None and not flush and not self._behind(self._done + 1, behind_m):
            return []
        held = self._store.blocks
        few = self._few_events(speed_m_s)
        if not held:
            return []
        found = []
        begin = end = held[0] - beside if self._done is None else self._done + 1
        for k in range(begin, held[-1] + beside + 1):
            if not (flush or self._behind(k, behind_m)):
                break
            if k > begin and not self._joins(begin, k, few):
                found += self._blocks(begin, k)
                begin = k
            end = k + 1
        # What few events are in waits for what it may be joined with.
        if flush or not self._joins(begin, end, few):
            found += self._blocks(begin, end)
        return found

    def _behind(self, k: int, behind_m: float) -> bool:
        """Whether a length and its margin lie before a place."""
        return (k + 1) * self._length_m + MARGIN_M <= behind_m

    def _joins(self, begin: int, k: int, few: Few) -> bool:
        """Whether a length becomes one block with those before it, by its events so far."""
        if k - begin > _MOST_JOINED:
            return False
        events = sum(self._store.count(j) for j in range(begin, k))
        if k - begin < _MOST_JOINED and events < few[0]:
            return self._store.count(k) < few[1]
        return self._store.count(k) < few[2] <= events

    def _few_events(self, speed_m_s: float) -> Few:
        """Events below which lengths are joined, of the one joined to them, and to a whole one."""
        if speed_m_s * _LONG_S <= self._length_m:
            return _FEW_EVENTS
        few, most, last = (self._rows * events for events in _FEW_FOR_FAST)
        return max(few, _FEW_EVENTS[0]), max(most, _FEW_EVENTS[1]), last

    def _blocks(self, begin: int, end: int) -> list[Block]:
        """The block of some lengths, if events reach it; they are done."""
        self._done = end - 1
        reach = range(begin - self._beside, end + self._beside)
        held = [j for j in self._store.blocks if j in reach and self._reaches(j, begin, end)]
        return [self._block(begin, end, tuple(held))] if held else []

    def _reaches(self, j: int, begin: int, end: int) -> bool:
        """Whether events of a length can reach the rows of others."""
        low, high, _, _ = self._store.span(j)
        start, length = (begin - j) * self._length_m, (end - begin) * self._length_m
        return start - self._reach_m <= high and low <= start + length + self._reach_m

    def _block(self, begin: int, end: int, sources: tuple[int, ...]) -> Block:
        inside = range(begin, end)
        times = [self._store.times(j) for j in sources if j in inside]
        times = times or [self._store.times(j) for j in sources]
        spans = [self._store.span(j) for j in sources]
        return Block(
            begin, end, sources, begin * self._length_m, end * self._length_m,
            min(s[2] for s in spans), max(s[3] for s in spans),
            min(t[0] for t in times), max(t[1] for t in times),
            sum(self._store.count(k) for k in inside),
        )  # fmt: skip

    def release(self, block: Block) -> None:
        """A block was measured: events that reach none of those that follow are forgotten."""
        self._store.release_before(block.end - self._beside)

    def drop_oldest(self) -> int:
        """Forget the oldest length and the rows that its events reach; how many events it held."""
        k = self._store.blocks[0]
        self._done = max(k + self._beside, self._done if self._done is not None else k)
        return self._store.release(k)
