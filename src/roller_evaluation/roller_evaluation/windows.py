"""Real windows with another number of events or another image size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.camera import Camera
from roller_core.events import EventArray

from .scans import Scan, between


@dataclass(frozen=True)
class Piece:
    """Events of one window with all that is needed to work on them.

    Attributes
    ----------
    start_ns, end_ns : int
        The window.
    events : EventArray
        First event at the start, last one just before the end.
    scan : Scan
        Where it is from.
    """

    start_ns: int
    end_ns: int
    events: EventArray
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


def scaled(events: EventArray, camera: Camera, scale: float) -> tuple[EventArray, Camera]:
    """The same window seen with an image of another size.

    Parameters
    ----------
    events : EventArray
        Events of the camera.
    camera : Camera
        Calibration.
    scale : float
        Of both sides of the image. Events of a larger image lie anywhere in the pixel they had.
    """
    if scale == 1.0:
        return events, camera
    rng = np.random.default_rng(0)
    width, height = round(camera.width * scale), round(camera.height * scale)
    x = ((events.x + rng.random(len(events))) * scale).astype(np.uint16)
    y = ((events.y + rng.random(len(events))) * scale).astype(np.uint16)
    moved = EventArray(
        np.minimum(x, np.uint16(width - 1)),
        np.minimum(y, np.uint16(height - 1)),
        events.t_ns,
        events.p,
    )
    # Pixel centres are whole numbers, so the corner of the image is at -0.5.
    larger = Camera(
        width,
        height,
        camera.fx * scale,
        camera.fy * scale,
        (camera.cx + 0.5) * scale - 0.5,
        (camera.cy + 0.5) * scale - 0.5,
        camera.distortion,
        camera.model,
    )
    return moved, larger
