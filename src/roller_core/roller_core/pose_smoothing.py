"""Taking the jitter out of the time stamps of a robot's poses.

A controller samples its pose at a fixed rate, but the stamps carry the jitter of transport and
operating system. Depth is travel over parallax: at 0.5 m/s 30 µs are 15 µm of travel, and half a
per mille more of it between two poses puts all of the surface 20 µm lower. So a stamp is that of
the line through many stamps over their numbers, as long as those around agree with it; positions
stay as they are.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from .pose_track import PoseOrderError
from .transforms import F64

T = TypeVar("T")
Mask = npt.NDArray[np.bool_]

#: Earlier poses that a line is drawn through, tried in turn.
_HISTORY = (256, 64, 16)
#: Stamps that lie further from the line than so many of their deviations count for nothing, nor do
#: those off by this share of the period. Where more than one of five is so, the rate isn't steady.
_FAR, _UNEVEN, _MOST_UNEVEN = 4.0, 0.25, 0.2
#: Most jitter of a steady rate, by the period; beyond this times the jitter from stamp to stamp,
#: stamps wander about the line.
_MOST_JITTER, _WANDERS = 0.06, 1.6
#: A line doesn't reach over more missing poses in a row.
_MOST_MISSING = 8
#: The stamps around may differ from the line by so many of their standard errors, and by this, ns.
_STRAY, _LEAST_NS = 2.5, 500.0
#: Controllers sample at whole milliseconds of their clock: the deviation of its rate, of crystals
#: apart from each other, and how many deviations a period may be off that.
_WHOLE_NS, _CLOCK, _OFF_CLOCK = 1e6, 5e-5, 3.0


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
        self._stamps: deque[int] = deque()  # of earlier items, then of those that wait
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
        self._waiting.append(item)
        self._stamps.append(t_ns)
        return [self._hand_out()] if len(self._waiting) > self.neighbours else []

    def finish(self) -> list[tuple[int, T]]:
        """Hand out what waits, with the neighbours that there are, and restart."""
        out = [self._hand_out() for _ in range(len(self._waiting))]
        self._stamps.clear()
        self._newest_ns = self._last_out = None
        return out

    def _hand_out(self) -> tuple[int, T]:
        item, own = self._waiting.popleft(), len(self._stamps) - len(self._waiting) - 1
        t_ns = self._stamps[own]
        if self.neighbours:
            relative = np.array([stamp - t_ns for stamp in self._stamps], np.float64)
            t_ns += round(_off(relative, own, self.neighbours))
        if self._last_out is not None:
            t_ns = max(t_ns, self._last_out + 1)
        self._last_out = t_ns
        if own == _HISTORY[0]:
            self._stamps.popleft()
        return t_ns, item


def _off(stamps: F64, own: int, reach: int) -> float:
    """What one of some stamps lacks of the line through them, ns; 0 where their rate isn't steady.

    Parameters
    ----------
    stamps : ndarray of float64, shape (n,)
        Rising, ns; that of `own` is 0.
    own : int
        Its place.
    reach : int
        Stamps on either side that must agree with the line.
    """
    steps = np.diff(stamps)
    if len(steps) < 2:
        return 0.0
    period = np.partition(steps, len(steps) // 2)[len(steps) // 2]
    if period <= 0:
        return 0.0
    counted = np.rint(steps / period)
    (apart,) = np.nonzero((counted < 1) | (counted > _MOST_MISSING))
    begin = int(apart[apart < own].max(initial=-1)) + 1
    end = int(apart[apart >= own].min(initial=len(steps))) + 1
    number = np.zeros(len(stamps))
    np.cumsum(counted, out=number[1:])
    for history in (*_HISTORY, reach):
        first = max(begin, own - history)
        line = _line(number[first:end], stamps[first:end], period)
        if line is None:
            continue
        rest, steady = line
        place = own - first
        even = abs(rest[place]) <= _UNEVEN * period
        if even and _agrees(rest, steady, place, reach, period):
            return float(stamps[own] - rest[place])
    return 0.0


def _line(number: F64, stamps: F64, period: float) -> tuple[F64, Mask] | None:
    """Residuals of stamps from the line through them over their numbers, and which count."""
    rest, steady, limit = stamps, np.ones(len(stamps), np.bool_), _UNEVEN * period
    for _ in range(3):
        n, t = number[steady], stamps[steady]
        if len(n) < max(3, (1.0 - _MOST_UNEVEN) * len(stamps)):
            return None
        middle, mean = n.sum() / len(n), t.sum() / len(t)
        n -= middle
        rest = stamps - (mean + _period(n, t - mean) * (number - middle))
        away = np.abs(rest)
        near = np.partition(away, len(away) // 2)[len(away) // 2] * 1.48
        within = away <= min(max(_FAR * near, _LEAST_NS), limit)
        if (within == steady).all():
            break
        steady = within
    return rest, steady


def _period(number: F64, stamps: F64) -> float:
    """Slope of the line through stamps over their numbers, both about their means.

    A few stamps tell it to some parts in ten thousand. Where that fits whole milliseconds, clocks
    tell it better, and it is the mean of both by what each is sure of.
    """
    spread = float(number @ number)
    own = float(number @ stamps) / spread
    whole = round(own / _WHOLE_NS) * _WHOLE_NS
    off = stamps - own * number
    unsure, clock = float(off @ off) / (len(off) * spread), (_CLOCK * whole) ** 2
    if not clock or (own - whole) ** 2 > _OFF_CLOCK**2 * (unsure + clock):
        return own
    return (own * clock + whole * unsure) / (clock + unsure)


def _agrees(rest: F64, steady: Mask, own: int, reach: int, period: float) -> bool:
    """Whether stamps scatter about their line, those around one as all do."""
    kept = rest[steady]
    change = np.diff(kept)
    jitter = float(np.sqrt(0.5 * (change @ change) / max(len(change), 1)))
    spread = float(np.sqrt((kept @ kept) / len(kept)))
    if jitter > _MOST_JITTER * period or spread > _WANDERS * jitter + _LEAST_NS:
        return False
    near = slice(max(own - reach, 0), own + reach + 1)
    around = rest[near][steady[near]]
    if not len(around):
        return False
    off = abs(float(around.sum()) / len(around))
    return off <= _STRAY * jitter / len(around) ** 0.5 + _LEAST_NS
