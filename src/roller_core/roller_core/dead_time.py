"""Events that a pixel's dead time has put in the wrong place, as against those that show an edge.

After an event a pixel is blind for its dead time. What changes meanwhile it tells when that is
over, or takes for its new level: either way its next event lies where the pixel woke up, and not
where an edge is. Where the sensor moves on by a part of a wall meanwhile, such events err by what
the two edges differ in height.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from . import numba_start  # noqa: F401 (before a kernel runs)
from .events import EventArray

#: Rows of which one is measured; gaps between events of a pixel that count, and their bins, ns.
_EVERY, _LONGEST_NS, _BIN_NS = 16, 10_000_000, 50_000
#: Gaps from which on there is a measurement, and how many of a pixel count, as one that fires by
#: itself has more than all others.
_ENOUGH, _MOST_OF_PIXEL = 1000, 8
#: The dead time ends in the first bin with so many times what any shorter one has, and with this
#: share of all: where brightness changes slowly gaps get more frequent bit by bit.
_TIMES, _SHARE = 8.0, 0.01
#: Gaps pile up where it ends: within the first time, ns, one bin has so many times what any has
#: up to the second. Else pixels had hardly anything left to tell as they woke up: on a smooth dome
#: what is left out costs more than it gains.
_PILE_NS, _AFTER_NS, _PILE_TIMES = 300_000, 600_000, 2.5
#: Dead time that is one, ns: what is shorter matters little, what is longer comes of the object;
#: and the travel from which on it matters, m.
_LEAST_NS, _MOST_NS, _LEAST_M = 700_000, 1_500_000, 2.5e-4
#: Travel from the end of the dead time on over which events still hang on it: a wall's flank, m.
_FLANK_M = 4.5e-4
#: It is longer by up to this, by pixel at random, m: else where late events begin to stay looked
#: like an edge behind every edge, with the parallax of that.
_SPREAD_M = 6e-4
#: A row of the image is busy with so many events a metre of travel; where this share of rows is, a
#: printed texture is what pixels see: objects are narrower. Looked at over so much travel, m.
_BUSY_PER_M, _TEXTURED, _LOOK_M = 4e3, 0.75, 1e-3
_NEVER_NS = -(2**62)

I64 = npt.NDArray[np.int64]


class DeadTime:
    """Measures the dead time of pixels, and leaves out what they tell too late.

    Parameters
    ----------
    width, height : int
        Of the image, px.

    Attributes
    ----------
    ns : int
        The dead time as far as it was seen; 0 while it isn't known or too short to matter.
    left_out : int
        Events left out.
    blind_m : float
        Travel of the sensor during the dead time, as of the last events; 0 where all stay.
    """

    def __init__(self, width: int, height: int) -> None:
        self._measured = np.full((-(-height // _EVERY), width), _NEVER_NS)
        self._counted = np.zeros(self._measured.shape, np.uint8)
        self._shape = height, width
        # Of each pixel, once it is asked for: of most sensors it never is.
        self._last: I64 = np.empty((0, 0), np.int64)
        self._gaps = np.zeros(_LONGEST_NS // _BIN_NS, np.int64)
        self._total = 0
        self._newest_ns = _NEVER_NS
        self._rows = np.zeros(height, np.int64)
        self._travel_m = 0.0
        self._textured = False
        self.ns = 0
        self.left_out = 0
        self.blind_m = 0.0

    @property
    def known(self) -> bool:
        """Whether enough was seen to say if there is a dead time that may matter."""
        return self._total >= _ENOUGH

    def measure(self, events: EventArray) -> bool:
        """Take events in order of time; whether there is a dead time that may matter.

        Events that were taken before, as of overlapping windows, start anew.

        Raises
        ------
        EventArrayError
            If one lies outside the image.
        """
        if not len(events):
            return self.ns > 0
        height, width = self._shape
        events.check_inside(width, height)
        if events.t_ns[0] < self._newest_ns:
            self._measured[:] = self._last[:] = _NEVER_NS
        self._newest_ns = int(events.t_ns[-1])
        found = _count_gaps(
            events.x, events.y, events.t_ns, self._measured, self._counted, self._gaps
        )
        self._total += found
        if found and self.known:
            self.ns = _dead_time_ns(self._gaps, self._total)
        return self.ns > 0

    def textured(self, events: EventArray, travel_m: float) -> bool:
        """Whether most rows of the image are busy, as under a printed texture.

        There edges lie as high as those before and after them, and what a pixel tells late tells of
        the same height: to leave it out would cost points and gain nothing.

        Parameters
        ----------
        events : EventArray
            The same as were measured.
        travel_m : float
            Of the sensor while they came, m.
        """
        self._rows += np.bincount(events.y, minlength=len(self._rows))
        self._travel_m += travel_m
        if self._travel_m >= _LOOK_M:
            busy = self._rows >= _BUSY_PER_M * self._travel_m
            self._textured = bool(busy.mean() >= _TEXTURED)
            self._rows[:], self._travel_m = 0, 0.0
        if self._textured:
            self.blind_m = 0.0
        return self._textured

    def without_followers(self, events: EventArray, speed_m_s: float) -> EventArray:
        """Events without those that came too soon after another of their pixel.

        Parameters
        ----------
        events : EventArray
            The same as were measured.
        speed_m_s : float
            Of the sensor, m/s. Where it hardly moves during the dead time, all events stay.
        """
        keep = np.empty(len(events), np.bool_)
        slow = not self.ns or speed_m_s * self.ns * 1e-9 < _LEAST_M
        self.blind_m = 0.0 if slow else speed_m_s * self.ns * 1e-9
        within = 0 if slow else self.ns + round(_FLANK_M / speed_m_s * 1e9)
        spread = 0 if slow else round(_SPREAD_M / speed_m_s * 1e9)
        if not self._last.size:
            self._last = np.full(self._shape, _NEVER_NS)
        _follow(events.x, events.y, events.t_ns, within, spread, self._last, keep)
        if slow:
            return events
        kept = events[keep]
        self.left_out += len(events) - len(kept)
        return kept


def _dead_time_ns(gaps: I64, total: int) -> int:
    """Where the gaps between a pixel's events begin and pile up, if that is late; else 0."""
    shorter = np.concatenate([[0], np.maximum.accumulate(gaps)[:-1]])
    begins = np.flatnonzero(gaps >= np.maximum(_TIMES * shorter, _SHARE * total))
    if not len(begins):
        return 0
    first = int(begins[0])
    found = first * _BIN_NS
    pile, after = np.split(gaps[first : first + _AFTER_NS // _BIN_NS], [_PILE_NS // _BIN_NS])
    piled = len(after) and pile.max() >= _PILE_TIMES * after.max()
    return found if _LEAST_NS <= found <= _MOST_NS and piled else 0


@njit(cache=True, nogil=True)
def _count_gaps(x, y, t, last, counted, gaps):  # type: ignore[no-untyped-def]
    """Count gaps between events of the pixels of some rows; `last`, `counted` are by those.

    Returns how many.
    """
    found = 0
    for i in range(np.uint64(len(t))):
        if y[i] & np.uint16(_EVERY - 1):
            continue
        row = y[i] // np.uint16(_EVERY)
        gap = t[i] - last[row, x[i]]
        last[row, x[i]] = t[i]
        if 0 <= gap < _LONGEST_NS and counted[row, x[i]] < _MOST_OF_PIXEL:
            counted[row, x[i]] += np.uint8(1)
            gaps[gap // _BIN_NS] += 1
            found += 1
    return found


@njit(cache=True, nogil=True)
def _follow(x, y, t, within, spread, last, keep):  # type: ignore[no-untyped-def]
    """Which events don't come `within` a time of another of their pixel, whatever that shows.

    The time is longer by up to `spread`, by pixel.
    """
    for i in range(len(t)):
        mixed = (np.uint32(x[i]) * np.uint32(73856093)) ^ (np.uint32(y[i]) * np.uint32(19349663))
        share = ((mixed >> np.uint32(8)) & np.uint32(1023)) / 1024.0
        keep[i] = t[i] - last[y[i], x[i]] >= within + share * spread
        last[y[i], x[i]] = t[i]
