"""Real windows with another number of events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.events import EventArray

from .scans import Scan, between


@dataclass(frozen=True)
class Piece:
    """Events of one window with all that is needed to work on them."""

    #: The window.
    start_ns: int
    end_ns: int
    #: First event at the start, last one just before the end.
    events: EventArray
    #: Where it is from.
    scan: Scan


def resample(events: EventArray, count: int, seed: int = 0) -> EventArray:
    """A number of events drawn from a list, in its order.

    Fewer are drawn without repeats; for more each one is repeated as often as it fits, and the
    rest is drawn.

    Parameters
    ----------
    events : EventArray
        At least one.
    count : int
        How many.
    seed : int
        The same seed draws the same events.
    """
    n = len(events)
    whole, rest = divmod(count, n)
    drawn = np.random.default_rng(seed).choice(n, rest, replace=False)
    times = np.full(n, whole, np.int64)
    times[drawn] += 1
    return events[np.repeat(np.arange(n), times)]


def window_pieces(scan: Scan, length_s: float, step_s: float, count: int) -> list[Piece]:
    """Windows of a scan that hold at least so many events, resampled to exactly that many.

    Parameters
    ----------
    scan : Scan
        The scan.
    length_s, step_s : float
        Length of a window and distance of their starts.
    count : int
        Events a window.
    """
    length, step = round(length_s * 1e9), round(step_s * 1e9)
    first, last = int(scan.even.t_ns[0]), int(scan.even.t_ns[-1])
    pieces = []
    for start in range(first, last - length + 1, step):
        inside = between(scan.even, start, start + length)
        if len(inside) >= count:
            pieces.append(_piece(scan, inside, start, start + length, count))
    return pieces


def densest_piece(scan: Scan, length_s: float, count: int) -> Piece:
    """The window of a scan with most events, resampled to a number of events."""
    length = round(length_s * 1e9)
    times = scan.even.t_ns
    ends = np.searchsorted(times, times + length)
    inside = np.where(times + length <= times[-1], ends - np.arange(len(times)), 0)
    start = int(times[int(np.argmax(inside))])
    events = between(scan.even, start, start + length)
    return _piece(scan, events, start, start + length, count)


def _piece(scan: Scan, events: EventArray, start_ns: int, end_ns: int, count: int) -> Piece:
    drawn = resample(events, count)
    # A window ends where its events do: the first and last one mark exactly this span.
    t_ns = drawn.t_ns.copy()
    t_ns[0], t_ns[-1] = start_ns, end_ns - 1
    return Piece(start_ns, end_ns, drawn.with_times(t_ns), scan)
