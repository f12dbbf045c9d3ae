"""Slow twin of the loops over the stamps of poses."""

import numpy as np
import numpy.typing as npt

from roller_core._stamp_kernels import (
    CLOCK,
    FAR,
    HISTORY,
    LEAST_NS,
    MOST_JITTER,
    MOST_MISSING,
    MOST_UNEVEN,
    NORMAL,
    OFF_CLOCK,
    STRAY,
    UNEVEN,
    WANDERS,
    WHOLE_NS,
)
from roller_core.transforms import F64

Mask = npt.NDArray[np.bool_]


def off(stamps: F64, own: int, reach: int) -> float:
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
    (apart,) = np.nonzero((counted < 1) | (counted > MOST_MISSING))
    begin = int(apart[apart < own].max(initial=-1)) + 1
    end = int(apart[apart >= own].min(initial=len(steps))) + 1
    number = np.zeros(len(stamps))
    np.cumsum(counted, out=number[1:])
    for history in (*HISTORY, reach):
        first = max(begin, own - history)
        line = _line(number[first:end], stamps[first:end], period)
        if line is None:
            continue
        rest, steady = line
        place = own - first
        even = abs(rest[place]) <= UNEVEN * period
        if even and _agrees(rest, steady, place, reach, period):
            return float(stamps[own] - rest[place])
    return 0.0


def _line(number: F64, stamps: F64, period: float) -> tuple[F64, Mask] | None:
    """Residuals of stamps from the line through them over their numbers, and which count."""
    rest, steady, limit = stamps, np.ones(len(stamps), np.bool_), UNEVEN * period
    for _ in range(3):
        n, t = number[steady], stamps[steady]
        if len(n) < max(3, (1.0 - MOST_UNEVEN) * len(stamps)):
            return None
        middle, mean = n.sum() / len(n), t.sum() / len(t)
        n -= middle
        rest = stamps - (mean + _period(n, t - mean) * (number - middle))
        away = np.abs(rest)
        near = np.partition(away, len(away) // 2)[len(away) // 2] * NORMAL
        within = away <= min(max(FAR * near, LEAST_NS), limit)
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
    whole = round(own / WHOLE_NS) * WHOLE_NS
    off = stamps - own * number
    unsure, clock = float(off @ off) / (len(off) * spread), (CLOCK * whole) ** 2
    if not clock or (own - whole) ** 2 > OFF_CLOCK**2 * (unsure + clock):
        return own
    return (own * clock + whole * unsure) / (clock + unsure)


def _agrees(rest: F64, steady: Mask, own: int, reach: int, period: float) -> bool:
    """Whether stamps scatter about their line, those around one as all do."""
    kept = rest[steady]
    change = np.diff(kept)
    jitter = float(np.sqrt(0.5 * (change @ change) / max(len(change), 1)))
    spread = float(np.sqrt((kept @ kept) / len(kept)))
    if jitter > MOST_JITTER * period or spread > WANDERS * jitter + LEAST_NS:
        return False
    near = slice(max(own - reach, 0), own + reach + 1)
    around = rest[near][steady[near]]
    if not len(around):
        return False
    off = abs(float(around.sum()) / len(around))
    return off <= STRAY * jitter / len(around) ** 0.5 + LEAST_NS
