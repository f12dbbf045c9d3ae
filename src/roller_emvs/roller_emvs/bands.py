"""Events sorted into bands of image rows, so that a band's votes stay in the cache.

A ray's pixel is linear in the plane's parameter, so the rows it can reach over all planes lie
between those of the two end planes. An event is listed in every band that it can reach; bands
without events cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from .threads import share

I64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Bands:
    """Rays by band."""

    #: Copies, in the order of band and of the events; a row for each number, as the loops over
    #: votes take them. Shape (4, m).
    rays: npt.NDArray[np.floating]
    #: Event that each is of; empty unless asked for. Shape (m,).
    source: I64
    #: Where bands begin and end. Shape (bands + 1,).
    starts: I64


def sort_into_bands(
    rays: npt.NDArray[np.floating],
    ends: tuple[float, float],
    shape: tuple[int, int],
    rows: int,
    reach: tuple[float, float],
    offset: int = 0,
    threads: int = 1,
    with_source: bool = False,
) -> Bands:
    """List each event in the bands it can reach.

    Parameters
    ----------
    rays : ndarray, shape (n, 4)
        Pixel (x, y) at parameter 0 and its change with the parameter; NaN goes nowhere.
    ends : tuple of float
        Parameters of the end planes.
    shape : tuple of int
        Rows and columns of the image.
    rows : int
        Rows of a band.
    reach : tuple of float
        Rows that a vote reaches up and down from its pixel.
    offset : int
        Columns by which the rays are moved.
    threads : int
        Threads that share the rays; the result doesn't depend on them.
    with_source : bool
        Whether the events that the copies are of are wanted.
    """
    count = -(-shape[0] // rows)
    bounds = np.array([*ends, *reach, *shape, offset], rays.dtype)
    low, high = np.empty(len(rays), np.int32), np.empty(len(rays), np.int32)
    edges = [len(rays) * k // threads for k in range(threads + 1)]
    counts = np.zeros((threads, count), np.int64)

    def find(k: int) -> None:
        own = slice(edges[k], edges[k + 1])
        _find(rays[own], bounds, rays.dtype.type(1.0 / rows), count, low[own], high[own])
        _count(low[own], high[own], counts[k])

    share(threads, threads, find)
    starts = np.zeros(count + 1, np.int64)
    np.cumsum(counts.sum(axis=0), out=starts[1:])
    # A band's rays are those of the first part, in their order, then those of the next.
    places = starts[:-1] + np.cumsum(counts, axis=0) - counts
    out = np.empty((4, starts[-1]), rays.dtype)
    source = np.empty(starts[-1] if with_source else 0, np.int64)

    def write(k: int) -> None:
        own = slice(edges[k], edges[k + 1])
        part = (low[own], high[own])
        if with_source:
            _list_source(*part, edges[k], places[k].copy(), source)
        _list(rays[own], *part, bounds[-1], places[k], out)

    share(threads, threads, write)
    return Bands(out, source, starts)


@njit(cache=True, nogil=True, error_model="numpy")
def _find(rays, bounds, share, count, low, high):  # type: ignore[no-untyped-def]
    """First and last band of each ray; last before first where there is none."""
    first, last, up, down, height, width, offset = bounds
    zero, end = share * 0, share * 0 + (count - 1)
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    flat = rays.reshape(-1)
    for i in range(np.uint64(len(low))):
        at = four * i
        x, y, dx, dy = flat[at] + offset, flat[at + one], flat[at + two], flat[at + three]
        x0, x1, y0, y1 = x + first * dx, x + last * dx, y + first * dy, y + last * dy
        # Not min and max, which ask for NaN: so this becomes vector instructions.
        left, right = (x0, x1) if x0 < x1 else (x1, x0)
        upper, lower = (y0, y1) if y0 < y1 else (y1, y0)
        top, bottom = upper - up, lower + down
        # Written so that NaN fails it.
        inside = (bottom >= 0) & (top < height) & (right >= -1) & (left < width + 1)
        low[i] = np.int32((top if top > zero else zero) * share if inside else share * 0 + 1)
        band = bottom * share
        high[i] = np.int32((band if band < end else end) if inside else zero)


@njit(cache=True, nogil=True)
def _count(low, high, counts):  # type: ignore[no-untyped-def]
    for i in range(len(low)):
        for b in range(low[i], high[i] + 1):
            counts[b] += 1


@njit(cache=True, nogil=True)
def _list(rays, low, high, offset, place, out):  # type: ignore[no-untyped-def]
    """Write each ray at its bands' places and move them on."""
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    flat, to, size = rays.reshape(-1), out.reshape(-1), np.uint64(out.shape[1])
    for i in range(np.uint64(len(low))):
        at = four * i
        x, y, dx, dy = flat[at] + offset, flat[at + one], flat[at + two], flat[at + three]
        for b in range(low[i], high[i] + 1):
            # Unsigned, as what may be negative is checked to count from the end.
            k = np.uint64(place[b])
            to[k] = x
            to[k + size] = y
            to[k + two * size] = dx
            to[k + three * size] = dy
            place[b] += 1


@njit(cache=True, nogil=True)
def _list_source(low, high, before, place, source):  # type: ignore[no-untyped-def]
    """As `_list`, for the numbers of the rays, of which `before` come before."""
    for i in range(len(low)):
        for b in range(low[i], high[i] + 1):
            source[place[b]] = before + i
            place[b] += 1
