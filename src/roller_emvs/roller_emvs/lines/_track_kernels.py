"""Loops that find the first track of a wall's events; each has a numpy twin in the tests.

Where pixels are dead for a while after an event, those of a wall come in tracks, the dead time's
travel apart: the first where the edge is, the next where pixels woke up, which an edge of the same
height that far away would show. A fit that takes in two tracks passes from one to the other over
the aperture as well as not, which is a line of another height.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Lines that tracks are looked for at, by what they part at the ends of the aperture: steps to
#: either side, px, and bins a px; events that are looked at.
_TURNS, _TURN_PX, _PER_PX = 6, 0.25, 4
_LOOK = 200
#: Share of the fullest track that the first one has, at least.
_FIRST = 0.5


@njit(cache=True, nogil=True, error_model="numpy")
def _count_across(across, slopes, d, place, bins):  # type: ignore[no-untyped-def]
    """Count events by their distance from a line that is turned by d, and sum the squared counts.

    `across` are their distances from the line as it is, in bins from the window's begin on. What
    lies outside counts into the first and the last of the `bins`, which hold nothing else. Counts
    are those of three neighbouring bins, the middle one twice.
    """
    n, d = np.uint64(len(across)), np.float32(d)
    low, high = np.float32(0), np.float32(len(bins) - 1)
    for i in range(n):
        place[i] = np.int32(min(max(across[i] - d * slopes[i], low), high))
    for k in range(np.uint64(len(bins))):
        bins[k] = 0
    for i in range(n):
        bins[np.uint64(place[i])] += np.int32(1)
    bins[0] = bins[-1] = 0
    squares = np.int32(0)
    for k in range(np.uint64(1), np.uint64(len(bins) - 1)):
        near = bins[k - np.uint64(1)] + np.int32(2) * bins[k] + bins[k + np.uint64(1)]
        squares += near * near
    return squares


@njit(cache=True, nogil=True, error_model="numpy")
def _first_track(events, count, line, middle, half, spread, forward, room, place, bins):  # type: ignore[no-untyped-def]
    """Turn a line to where events gather the most across it, and move it to their first track.

    Of the lines that differ from it at the ends of an aperture of variance `spread`, the one across
    which the squared counts of events, about `_LOOK` of them, are the largest. `forward` is 1 where
    the first events of a crossing lie at the least x, else -1. `room`, `place` and `bins` are for
    what is worked on.
    """
    per, m, middle = np.float32(_PER_PX), np.float32(line[2]), np.float32(middle)
    first, own = np.float32(half * _PER_PX + 1), np.float32(line[1])
    every = np.uint64(max(np.int64(count) // _LOOK, 1))
    n = np.uint64(0)
    for i in range(np.uint64(0), np.uint64(count), every):
        slope = events[2, i] - middle
        room[0, n] = (events[0, i] - own * slope - m * events[1, i]) * per + first
        room[1, n] = slope * per
        n += np.uint64(1)
    across, slopes = room[0, :n], room[1, :n]
    step = _TURN_PX / np.sqrt(3.0 * spread)
    best, most = 0, np.int32(-1)
    for turn in range(-_TURNS, _TURNS + 1):
        squares = _count_across(across, slopes, turn * step, place, bins)
        if squares > most:
            best, most = turn, squares
    _count_across(across, slopes, best * step, place, bins)
    full, last = np.int32(0), len(bins) - 1
    for k in range(1, last):
        full = max(full, bins[k - 1] + 2 * bins[k] + bins[k + 1])
    at, level = len(bins) // 2, np.int32(0)
    for j in range(1, last):
        k = j if forward > 0 else last - j
        near = bins[k - 1] + 2 * bins[k] + bins[k + 1]
        if near < level:
            break
        if near >= _FIRST * full:
            at, level = k, near
    line[0] = (at - 0.5) / _PER_PX - half
    line[1] += best * step
