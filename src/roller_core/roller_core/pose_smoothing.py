"""Taking the jitter out of the time stamps of a robot's poses.

A controller samples its pose at a fixed rate, but the stamps carry the jitter of transport and
operating system. Depth is travel over parallax: at 0.5 m/s 30 µs are 15 µm of travel, and half a
per mille more of it between two poses puts all of the surface 20 µm lower. So a stamp is that of
the line through many stamps over their numbers, as long as those around agree with it; positions
stay as they are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from .pose_track import PoseOrderError

T = TypeVar("T")

#: Earlier stamps that count at most.
EARLIER = 256
#: Room for so many times the stamps that are kept.
_ROOM = 4


class StampSmoother(Generic[T]):
    """Delays items by some neighbours and hands them out with smoothed stamps.

    What comes out depends on the sequence alone, not on when it came.

    Parameters
    ----------
    neighbours : int
        Later items that each waits for; their stamps count, and those of up to 256 earlier ones.
        0 changes nothing.
    """

    def __init__(self, neighbours: int) -> None:
        self.neighbours = neighbours
        self._waiting: deque[T] = deque()
        # Stamps of earlier items, then of those that wait, and where they begin and end.
        self._stamps = np.empty(_ROOM * (EARLIER + neighbours + 1), np.int64)
        self._begin = self._end = 0
        self._newest_ns: int | None = None
        self._last_out: int | None = None
        self._off: Callable[[int], float] | None = self._kernel() if neighbours else None

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
        self._waiting.append(item)
        if self._end == len(self._stamps):
            kept = self._stamps[self._begin :].copy()
            self._begin, self._end = 0, len(kept)
            self._stamps[: self._end] = kept
        self._stamps[self._end] = t_ns
        self._end += 1
        return [self._hand_out()] if len(self._waiting) > self.neighbours else []

    def finish(self) -> list[tuple[int, T]]:
        """Hand out what waits, with the neighbours that there are, and restart."""
        out = [self._hand_out() for _ in range(len(self._waiting))]
        self._begin = self._end = 0
        self._newest_ns = self._last_out = None
        return out

    def _hand_out(self) -> tuple[int, T]:
        item = self._waiting.popleft()
        own = self._end - self._begin - len(self._waiting) - 1
        t_ns = int(self._stamps[self._begin + own])
        if self._off is not None:
            t_ns += round(self._off(own))
        if self._last_out is not None:
            t_ns = max(t_ns, self._last_out + 1)
        self._last_out = t_ns
        if own == EARLIER:
            self._begin += 1
        return t_ns, item

    def _kernel(self) -> Callable[[int], float]:
        """What the stamp at a place lacks of the line through them, ns, ready to be called."""
        from . import _stamp_kernels as kernels  # numba: for those alone who smooth

        buffers = kernels.stamp_buffers(EARLIER + self.neighbours + 1)
        kernels._off(np.zeros(3, np.int64), 1, 1, buffers)

        def off(own: int) -> float:
            stamps = self._stamps[self._begin : self._end]
            return float(kernels._off(stamps, own, self.neighbours, buffers))

        return off
