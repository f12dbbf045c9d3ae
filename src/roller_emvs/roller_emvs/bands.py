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

I64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Bands:
    """Rays by group and band.

    Attributes
    ----------
    rays : ndarray, shape (m, 4)
        Copies, in the order of group, band and of the events.
    source : ndarray of int64, shape (m,)
        Event that each is of.
    starts : ndarray of int64, shape (groups, bands + 1)
        Where a group's bands begin and end.
    """

    rays: npt.NDArray[np.floating]
    source: I64
    starts: I64


def sort_into_bands(
    rays: npt.NDArray[np.floating],
    groups: I64,
    ends: tuple[float, float],
    shape: tuple[int, int],
    rows: int,
    reach: tuple[float, float],
) -> Bands:
    """List each event in the bands it can reach.

    Parameters
    ----------
    rays : ndarray, shape (n, 4)
        Pixel (x, y) at parameter 0 and its change with the parameter; NaN goes nowhere.
    groups : ndarray of int64, shape (k + 1,)
        Where groups of events begin; the last entry is n.
    ends : tuple of float
        Parameters of the end planes.
    shape : tuple of int
        Rows and columns of the image.
    rows : int
        Rows of a band.
    reach : tuple of float
        Rows that a vote reaches up and down from its pixel.
    """
    count = -(-shape[0] // rows)
    counts = np.zeros((len(groups) - 1, count), np.int64)
    bounds = np.array([*ends, *reach, shape[0], shape[1]], np.float64)
    nothing = (np.empty((0, 4), rays.dtype), np.empty(0, np.int64))
    _sort(rays, groups, bounds, rows, counts, False, *nothing)
    starts = np.zeros((len(groups) - 1, count + 1), np.int64)
    flat = np.concatenate([[0], np.cumsum(counts)])
    for g in range(len(groups) - 1):
        starts[g] = flat[g * count : (g + 1) * count + 1]
    out = np.empty((flat[-1], 4), rays.dtype), np.empty(flat[-1], np.int64)
    _sort(rays, groups, bounds, rows, starts[:, :-1].copy(), True, *out)
    return Bands(*out, starts)


@njit(cache=True, nogil=True)
def _sort(rays, groups, bounds, rows, place, write, out, source):  # type: ignore[no-untyped-def]
    """Count into `place`, or write at `place` and move it on."""
    first, last, up, down, height, width = bounds
    bands = place.shape[1]
    share = 1.0 / rows
    for g in range(len(groups) - 1):
        for i in range(groups[g], groups[g + 1]):
            y0 = rays[i, 1] + first * rays[i, 3]
            y1 = rays[i, 1] + last * rays[i, 3]
            x0 = rays[i, 0] + first * rays[i, 2]
            x1 = rays[i, 0] + last * rays[i, 2]
            top = min(y0, y1) - up
            bottom = max(y0, y1) + down
            # Written so that NaN fails it.
            if not (bottom >= 0 and top < height and max(x0, x1) >= -1 and min(x0, x1) < width + 1):
                continue
            low = int(max(top, 0.0) * share)
            high = min(int(bottom * share), bands - 1)
            for b in range(low, high + 1):
                if write:
                    k = place[g, b]
                    out[k, 0] = rays[i, 0]
                    out[k, 1] = rays[i, 1]
                    out[k, 2] = rays[i, 2]
                    out[k, 3] = rays[i, 3]
                    source[k] = i
                place[g, b] += 1
