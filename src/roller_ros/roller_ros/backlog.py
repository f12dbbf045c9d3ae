"""What waits for a node's worker, in order and bounded: events in bytes, the rest in messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Bulk:
    """What there is much of: its size in bytes, and the time that it is of, ns."""

    size: int
    t_ns: int


@dataclass(frozen=True, slots=True)
class Entry(Generic[T]):
    """An item that waits; what it is, if it is bulk."""

    item: T
    bulk: Bulk | None


class Backlog(Generic[T]):
    """Items in order; bulk never makes another item go.

    Parameters
    ----------
    limit : int
        Items other than bulk that may wait; beyond it the oldest is dropped and counted.
    most_bytes : int
        Bulk that may wait, bytes; beyond it a stretch of the oldest is left out, down to half.
        What came last always stays.
    most_behind_ns : int
        How far the oldest bulk that waits may be behind the newest; 0: however far. Beyond it what
        is further behind than half of that is left out.
    gap : callable, optional
        Makes the item that stands in place of a stretch of bulk, from the number of its items.

    Attributes
    ----------
    dropped : int
        Items other than bulk that found no place.
    left_out : int
        Items of bulk that were left out.
    waiting_bytes : int
        Bulk that waits.
    """

    def __init__(
        self,
        limit: int,
        most_bytes: int = 2**62,
        most_behind_ns: int = 0,
        gap: Callable[[int], T] | None = None,
    ) -> None:
        self._limit, self._most_bytes, self._most_behind_ns = limit, most_bytes, most_behind_ns
        self._gap = gap
        self._entries: deque[Entry[T]] = deque()
        self._bulk: deque[Bulk] = deque()
        self.dropped = self.left_out = self.waiting_bytes = 0

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def waiting_bulk(self) -> int:
        """Items of bulk that wait."""
        return len(self._bulk)

    def add(self, item: T, bulk: Bulk | None = None) -> None:
        """Take an item, bulk or not."""
        if bulk is None and len(self._entries) - len(self._bulk) >= self._limit:
            del self._entries[next(k for k, e in enumerate(self._entries) if e.bulk is None)]
            self.dropped += 1
        self._entries.append(Entry(item, bulk))
        if bulk is not None:
            self._bulk.append(bulk)
            self.waiting_bytes += bulk.size
            if count := self._too_much(bulk.t_ns):
                self._leave_out(count)

    def take(self) -> Entry[T] | None:
        """The oldest; None when nothing waits."""
        if not self._entries:
            return None
        entry = self._entries.popleft()
        if entry.bulk is not None:
            self.waiting_bytes -= self._bulk.popleft().size
        return entry

    def _too_much(self, newest_ns: int) -> int:
        """How many of the oldest items of bulk have to go."""
        count, most = 0, len(self._bulk) - 1
        if self.waiting_bytes > self._most_bytes:
            left = self.waiting_bytes
            while left > self._most_bytes // 2 and count < most:
                left -= self._bulk[count].size
                count += 1
        behind_ns = self._most_behind_ns
        if behind_ns and newest_ns - self._bulk[0].t_ns > behind_ns:
            late = sum(newest_ns - b.t_ns > behind_ns // 2 for b in islice(self._bulk, most))
            count = max(count, late)
        return count

    def _leave_out(self, count: int) -> None:
        kept: deque[Entry[T]] = deque()
        left = count
        for entry in self._entries:
            if entry.bulk is None or not left:
                kept.append(entry)
                continue
            if left == count and self._gap is not None:
                kept.append(Entry(self._gap(count), None))
            left -= 1
            self.waiting_bytes -= self._bulk.popleft().size
        self._entries = kept
        self.left_out += count
