"""Taking the jitter out of the time stamps of a robot's poses.

A controller samples its pose at a fixed rate, but the stamps carry the jitter of transport and
operating system. At 0.5 m/s 30 µs are 15 µm of baseline, a third of a pixel. The mean stamp of
neighbours on both sides is the stamp in the middle where the rate is steady, whatever the robot
does meanwhile; positions stay as they are.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from typing import Generic, TypeVar

from .pose_track import PoseOrderError

T = TypeVar("T")

#: Neighbouring steps that differ by more than this share of their median are no steady rate.
_UNEVEN = 0.25


class StampSmoother(Generic[T]):
    """Delays items by some neighbours and hands them out with smoothed stamps.

    What comes out depends on the sequence alone, not on when it came.

    Parameters
    ----------
    neighbours : int
        Items on either side whose stamps are averaged; 0 changes nothing.
    """

    def __init__(self, neighbours: int) -> None:
        self.neighbours = neighbours
        self._items: deque[tuple[int, T]] = deque()
        self._done = 0  # items at the front that were handed out and serve as neighbours
        self._newest_ns: int | None = None
        self._last_out: int | None = None

    def push(self, t_ns: int, item: T) -> list[tuple[int, T]]:
        """Take an item; hand out the one that now has all its neighbours.

        Raises
        ------
        PoseOrderError
            If it is older than the newest one; it is left out.
        """
        if self._newest_ns is not None and t_ns < self._newest_ns:
            raise PoseOrderError.between(t_ns, self._newest_ns)
        self._newest_ns = t_ns
        self._items.append((t_ns, item))
        waiting = len(self._items) - self._done
        return [self._hand_out()] if waiting > self.neighbours else []

    def finish(self) -> list[tuple[int, T]]:
        """Hand out what waits, with the neighbours that there are, and restart."""
        out = []
        while self._done < len(self._items):
            out.append(self._hand_out())
        self._items.clear()
        self._done = 0
        self._newest_ns = self._last_out = None
        return out

    def _hand_out(self) -> tuple[int, T]:
        k = self._done
        reach = min(k, len(self._items) - 1 - k, self.neighbours)
        t_ns, item = self._items[k]
        if reach:
            # In plain Python: arrays of nine numbers cost more than they save.
            stamps = [self._items[j][0] for j in range(k - reach, k + reach + 1)]
            if _is_even(stamps):
                t_ns = stamps[0] + round(sum(t - stamps[0] for t in stamps) / len(stamps))
        if self._last_out is not None:
            t_ns = max(t_ns, self._last_out + 1)
        self._last_out = t_ns
        self._done += 1
        if self._done > self.neighbours:
            self._items.popleft()
            self._done -= 1
        return t_ns, item


def _is_even(stamps: list[int]) -> bool:
    """Whether the steps between an odd number of stamps hardly differ from their median."""
    steps = sorted(b - a for a, b in pairwise(stamps))
    half = len(steps) // 2
    middle = (steps[half - 1] + steps[half]) / 2
    furthest = max(middle - steps[0], steps[-1] - middle)
    return middle > 0 and furthest <= _UNEVEN * middle
