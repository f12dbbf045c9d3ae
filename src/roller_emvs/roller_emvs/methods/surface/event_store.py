"""Events that wait for their rows to be out of view: each once, in pages, 8 bytes an event.

The x axis of a strip is cut into blocks of one length; an event belongs to the block in which its
ray meets the strip's middle plane. `EventStore.events` gives those of one block and polarity as
arrays, while the block is held: until a few blocks after it was done (see `Strip.take`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray
from roller_core.transforms import F64
from roller_emvs.rays import F32, I64

from . import _event_kernels as kernels
from ._event_kernels import PAGE, PIECES

I32 = npt.NDArray[np.int32]
U16 = npt.NDArray[np.uint16]
#: Pages of a store: place in the piece and slope, shape (pages, 2, PAGE), and y, shape (pages,
#: PAGE).
Records = tuple[U16, F32]

#: Pages at first, of eight million events: memory that the system gives when they are used, and
#: what is held then need not be copied where there are more.
_FIRST_PAGES = 4096


@dataclass(frozen=True)
class StripEvents:
    """Events where their rays meet a strip's middle plane, in order of time by pieces of blocks."""

    #: Place; x from the start of a block on. Shape (n,).
    x_m: F32
    y_m: F32
    #: dx/dz of the rays in the strip: at an offset z from the middle plane an event is at x_m +
    #: slope · z. Shape (n,).
    slope: F32

    def __len__(self) -> int:
        return len(self.x_m)


class EventStore:
    """Pages of events by block and polarity.

    Parameters
    ----------
    length_m : float
        Length of a block.
    steepest : float
        Largest slope of an event.
    """

    def __init__(self, length_m: float, steepest: float) -> None:
        self._length_m = length_m
        self.steepest = steepest
        #: Length of a piece.
        self.piece_m = length_m / PIECES
        self._slots: dict[int, int] = {}
        self._spare: list[int] = []
        self.records: Records = (
            np.empty((0, 2, PAGE), np.uint16),
            np.empty((0, PAGE), np.float32),
        )
        self.link = np.empty(0, np.int32)
        self._free = np.empty(0, np.int32)
        self._free_count = 0
        self._pages = np.empty((0, 2 * PIECES, 2), np.int32)
        self._counts = np.empty((0, 2 * PIECES), np.int64)
        self._ends = np.empty((0, 2), np.int64)
        # Of each block, as of so many events.
        self._spans: dict[int, tuple[int, tuple[float, float, float, float]]] = {}
        self.held = 0

    @property
    def blocks(self) -> list[int]:
        """Numbers of the blocks that hold events, in order."""
        counts = self._counts.sum(axis=1)
        return sorted(k for k, slot in self._slots.items() if counts[slot])

    def add(
        self, placed: F32, events: EventArray, start_m: float, low: int, blocks: Iterable[int]
    ) -> None:
        """Take events where `_place` put them, `start_m` from the start of block `low` on.

        Those of other blocks than `blocks`, in order from `low` on, are left out.
        """
        wanted = list(blocks)
        slots = np.full(wanted[-1] - low + 1, -1, np.int64)
        for k in wanted:
            slots[k - low] = self._slot(k)
        self._reserve(len(events) // PAGE + 2 * PIECES * len(wanted) + 1)
        kept, self._free_count = kernels._keep(
            placed, events.t_ns, events.p, -start_m, self._length_m, self.steepest, slots,
            self.records, self.link, self._free, self._free_count, self._pages, self._counts,
            self._ends,
        )  # fmt: skip
        self.held += kept

    def _slot(self, k: int) -> int:
        """Where a block's pages are listed, made for it if it has none yet."""
        if k not in self._slots:
            if not self._spare:
                n = len(self._counts)
                room = n + max(n, 16)
                self._spare = list(range(n, room))
                self._pages, self._counts = _grown(self._pages, room), _grown(self._counts, room)
                self._ends = _grown(self._ends, room)
            slot = self._slots[k] = self._spare.pop()
            self._pages[slot] = -1
            self._counts[slot] = 0
            self._ends[slot] = np.iinfo(np.int64).max, 0
        return self._slots[k]

    def _reserve(self, pages: int) -> None:
        """See that so many pages are free."""
        held = len(self.link)
        if self._free_count >= pages:
            return
        more = max(pages, held, _FIRST_PAGES)
        room = held + more
        self.records = _grown(self.records[0], room), _grown(self.records[1], room)
        self.link, self._free = _grown(self.link, room), _grown(self._free, room)
        self._free[self._free_count : self._free_count + more] = np.arange(held, room)
        self._free_count += more

    def count(self, k: int, polarity: int | None = None) -> int:
        """Events of a block, of one polarity or of both."""
        slot = self._slots.get(k)
        if slot is None:
            return 0
        counts = self._counts[slot].reshape(2, PIECES)
        return int(counts.sum() if polarity is None else counts[polarity].sum())

    def span(self, k: int) -> tuple[float, float, float, float]:
        """Least and largest x and y of a block's events, metres, x from its start on."""
        slot, count = self._slots[k], self.count(k)
        if k not in self._spans or self._spans[k][0] != count:
            low_x, high_x, low_y, high_y = kernels._span(
                self.records, self.link, self._pages[slot, :, 0], self._counts[slot], self.piece_m
            )
            self._spans[k] = count, (low_x, high_x, low_y, high_y)
        return self._spans[k][1]

    def times(self, k: int) -> tuple[int, int]:
        """Times of a block's first and last event."""
        first, last = self._ends[self._slots[k]].tolist()
        return first, last

    def chains(
        self, k: int, polarity: int, low_m: float = -np.inf, high_m: float = np.inf
    ) -> tuple[F64, I32, I64]:
        """Start, first page and number of the events of each piece of a block, of one polarity.

        Pieces that lie below `low_m` or beyond `high_m`, from the block's start on, are left out;
        the first page of an empty one is -1. Starts are from the block's on, metres.
        """
        slot = self._slots.get(k)
        if slot is None:
            return np.empty(0), np.empty(0, np.int32), np.empty(0, np.int64)
        begin = max(math.ceil(max(low_m / self.piece_m, 0.0)) - 1, 0)
        end = max(begin, math.floor(min(high_m / self.piece_m, PIECES - 1)) + 1)
        own = slice(polarity * PIECES + begin, polarity * PIECES + end)
        starts: F64 = np.arange(begin, end, dtype=np.float64) * self.piece_m
        return starts, self._pages[slot, own, 0], self._counts[slot, own]

    def events(self, k: int, polarity: int, shift_m: float = 0.0) -> StripEvents:
        """Events of a block and polarity as arrays, x `shift_m` further on."""
        total, n = self.count(k, polarity), 0
        x, y, slope = (np.empty(total, np.float32) for _ in range(3))
        chains = (v.tolist() for v in self.chains(k, polarity))
        for start, page, count in zip(*chains, strict=True):
            kernels._collect(
                self.records, self.link, page, count, self.piece_m, self.steepest, start + shift_m,
                x[n:], y[n:], slope[n:],
            )  # fmt: skip
            n += count
        return StripEvents(x, y, slope)

    def release_before(self, k: int) -> None:
        """Forget all blocks before one, those that no event came to after all among them."""
        for before in [j for j in self._slots if j < k]:
            self.release(before)

    def release(self, k: int) -> int:
        """Forget a block; how many events it held."""
        slot = self._slots.pop(k, None)
        self._spans.pop(k, None)
        if slot is None:
            return 0
        for page in self._pages[slot, :, 0].tolist():
            self._free_count = kernels._release(self.link, page, self._free, self._free_count)
        self._spare.append(slot)
        count = int(self._counts[slot].sum())
        self.held -= count
        return count


def _grown(values: np.ndarray, room: int) -> np.ndarray:
    """The same with room for more, which isn't touched."""
    out = np.empty((room, *values.shape[1:]), values.dtype)
    out[: len(values)] = values
    return out
