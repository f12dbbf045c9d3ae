"""Loops over the stamps of poses; each has a numpy twin in the tests.

A stamp is looked at together with hundreds of others, at every pose, in every node.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from . import numba_start  # noqa: F401 (before a kernel runs)
from .pose_smoothing import EARLIER

#: Earlier stamps that a line is drawn through, tried in turn.
HISTORY = (EARLIER, 64, 16)
#: Stamps that lie further from the line than so many of their deviations count for nothing, nor do
#: those off by this share of the period. Where more than one of five is so, the rate isn't steady.
FAR, UNEVEN, MOST_UNEVEN = 4.0, 0.25, 0.2
#: Most jitter of a steady rate, by the period; beyond this times the jitter from stamp to stamp,
#: stamps wander about the line.
MOST_JITTER, WANDERS = 0.07, 1.6
#: A line doesn't reach over more missing poses in a row.
MOST_MISSING = 8
#: The stamps around may differ from the line by so many of their standard errors, and by this, ns.
STRAY, LEAST_NS = 2.5, 500.0
#: Controllers sample at whole milliseconds of their clock: the deviation of its rate, of crystals
#: apart from each other, and how many deviations a period may be off that.
WHOLE_NS, CLOCK, OFF_CLOCK = 1e6, 5e-5, 3.0
#: Deviation of a normal distribution by its median absolute one.
NORMAL = 1.48


@njit(cache=True, nogil=True)
def _ranked(values, count, rank):  # type: ignore[no-untyped-def]
    """The value of a rank, from 0 on, among the first `count`, which are moved about for it."""
    low, high = 0, count - 1
    while low < high:
        pivot = values[(low + high) >> 1]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return values[rank]


@njit(cache=True, nogil=True, error_model="numpy")
def _off(stamps_ns, own, reach, buffers):  # type: ignore[no-untyped-def]
    """What one of some stamps lacks of the line through them, ns; 0 where their rate isn't steady.

    stamps_ns: int64 (n,), growing; own: place of the one; reach: stamps on either side that must
    agree with the line; buffers: see `stamp_buffers`.
    """
    stamps, number, rest, room, steady = buffers
    n = len(stamps_ns)
    if n < 3:
        return 0.0
    for i in range(n):
        stamps[i] = np.float64(stamps_ns[i] - stamps_ns[own])
    for i in range(n - 1):
        room[i] = stamps[i + 1] - stamps[i]
    period = _ranked(room, n - 1, (n - 1) // 2)
    if period <= 0:
        return 0.0
    begin, end = 0, n
    number[0] = 0.0
    for i in range(n - 1):
        counted = np.rint((stamps[i + 1] - stamps[i]) / period)
        number[i + 1] = number[i] + counted
        if counted < 1 or counted > MOST_MISSING:
            if i < own:
                begin = i + 1
            else:
                end = i + 1
                break
    for k in range(len(HISTORY) + 1):
        history = HISTORY[k] if k < len(HISTORY) else reach
        first = max(begin, own - history)
        lined = slice(first, end)
        if not _line(number[lined], stamps[lined], period, rest, steady, room):
            continue
        place = own - first
        if abs(rest[place]) <= UNEVEN * period and _agrees(
            rest, steady, end - first, place, reach, period
        ):
            return stamps[own] - rest[place]
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _line(number, stamps, period, rest, steady, room):  # type: ignore[no-untyped-def]
    """Write residuals of stamps from the line through them over their numbers, and which count.

    False where too few do.
    """
    n = len(stamps)
    steady[:n] = True
    for _ in range(3):
        count, middle, mean = 0, 0.0, 0.0
        for i in range(n):
            if steady[i]:
                count += 1
                middle += number[i]
                mean += stamps[i]
        if count < max(3.0, (1.0 - MOST_UNEVEN) * n):
            return False
        middle /= count
        mean /= count
        slope = _period(number, stamps, steady, middle, mean, count)
        for i in range(n):
            rest[i] = stamps[i] - (mean + slope * (number[i] - middle))
            room[i] = abs(rest[i])
        near = _ranked(room, n, n // 2) * NORMAL
        most = min(max(FAR * near, LEAST_NS), UNEVEN * period)
        same = True
        for i in range(n):
            within = abs(rest[i]) <= most
            same &= within == steady[i]
            steady[i] = within
        if same:
            break
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _period(number, stamps, steady, middle, mean, count):  # type: ignore[no-untyped-def]
    """Slope of the line through the stamps that count over their numbers.

    A few stamps tell it to some parts in ten thousand. Where that fits whole milliseconds, clocks
    tell it better, and it is the mean of both by what each is sure of.
    """
    spread, product = 0.0, 0.0
    for i in range(len(stamps)):
        if steady[i]:
            spread += (number[i] - middle) ** 2
            product += (number[i] - middle) * (stamps[i] - mean)
    own = product / spread
    whole = np.rint(own / WHOLE_NS) * WHOLE_NS
    left = 0.0
    for i in range(len(stamps)):
        if steady[i]:
            left += (stamps[i] - mean - own * (number[i] - middle)) ** 2
    unsure, clock = left / (count * spread), (CLOCK * whole) ** 2
    if clock == 0.0 or (own - whole) ** 2 > OFF_CLOCK**2 * (unsure + clock):
        return own
    return (own * clock + whole * unsure) / (clock + unsure)


@njit(cache=True, nogil=True, error_model="numpy")
def _agrees(rest, steady, n, own, reach, period):  # type: ignore[no-untyped-def]
    """Whether n stamps scatter about their line, those around one as all do."""
    count, square, change, before = 0, 0.0, 0.0, 0.0
    near, total = 0, 0.0
    for i in range(n):
        if not steady[i]:
            continue
        square += rest[i] * rest[i]
        if count:
            change += (rest[i] - before) ** 2
        before = rest[i]
        count += 1
        if abs(i - own) <= reach:
            near += 1
            total += rest[i]
    jitter = np.sqrt(0.5 * change / max(count - 1, 1))
    if jitter > MOST_JITTER * period or np.sqrt(square / count) > WANDERS * jitter + LEAST_NS:
        return False
    if near == 0:
        return False
    return abs(total / near) <= STRAY * jitter / np.sqrt(near) + LEAST_NS


def stamp_buffers(count: int) -> tuple[np.ndarray, ...]:
    """Buffers of `_off` for up to so many stamps."""
    return (*(np.empty(count) for _ in range(4)), np.empty(count, np.bool_))
