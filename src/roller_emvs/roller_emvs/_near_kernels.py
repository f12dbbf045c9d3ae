"""Loops over the cells of a plane grid for the nearest of a cloud; each has a numpy twin."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from roller_core import numba_start  # noqa: F401 (before a kernel runs)


@njit(cache=True, nogil=True)
def _bounds(points, low, high):  # type: ignore[no-untyped-def]
    """Least and most of each coordinate: points float64 (n, 3), low, high (3,), written to."""
    for c in range(3):
        least = most = points[0, c]
        for i in range(len(points)):
            least, most = min(least, points[i, c]), max(most, points[i, c])
        low[c], high[c] = least, most


@njit(cache=True, nogil=True)
def _cell(x, least, edge, size):  # type: ignore[no-untyped-def]
    """Cell of a place along an axis; of one beyond the grid the outermost."""
    place = (x - least) / edge
    return np.int64(min(max(place, 0.0), size - 1.0))


@njit(cache=True, nogil=True)
def _sort(points, axes, least, edge, starts, order):  # type: ignore[no-untyped-def]
    """Numbers of points by cell of a grid over two axes.

    points: float64 (n, 3), metres; axes: numbers of both; least: where the grid begins along each;
    edge: of a cell, metres; starts: int64 (rows, columns + 1), zero, set to where each cell's begin
    in `order`, int64 (n,), and where its row ends.
    """
    rows, columns = starts.shape[0], starts.shape[1] - 1
    flat = starts.reshape(-1)
    for i in range(len(points)):
        a = _cell(points[i, axes[0]], least[0], edge, rows)
        b = _cell(points[i, axes[1]], least[1], edge, columns)
        flat[a * (columns + 1) + b] += 1
    n = 0
    for k in range(len(flat)):
        count = flat[k]
        flat[k] = n
        n += count
    for i in range(len(points)):
        a = _cell(points[i, axes[0]], least[0], edge, rows)
        b = _cell(points[i, axes[1]], least[1], edge, columns)
        k = a * (columns + 1) + b
        order[flat[k]] = i
        flat[k] += 1
    # Each now holds where the next begins.
    for k in range(len(flat) - 1, 0, -1):
        flat[k] = flat[k - 1]
    flat[0] = 0


@njit(cache=True, nogil=True)
def _beyond(x, cell, ring, edge, size):  # type: ignore[no-untyped-def]
    """How far the next cells along an axis are from a place: those beyond a ring around a cell."""
    before = x - (cell - ring) * edge if cell - ring > 0 else np.inf
    after = (cell + ring + 1) * edge - x if cell + ring < size - 1 else np.inf
    return min(before, after)


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest(points, starts, order, axes, least, edge, places, most, away, number):  # type: ignore[no-untyped-def]
    """Nearest of the cloud to each of some places, not further than `most`.

    points, starts, order, axes, least, edge: as `_sort` takes and leaves them; places: float64
    (m, 3); away: float64 (m, k), growing, infinite where there are fewer; number: int64 (m, k),
    len(points) there.
    """
    rows, columns = starts.shape[0], starts.shape[1] - 1
    wanted = away.shape[1]
    for i in range(len(places)):
        x, y, z = places[i]
        along, across = places[i, axes[0]] - least[0], places[i, axes[1]] - least[1]
        a = _cell(along, 0.0, edge, rows)
        b = _cell(across, 0.0, edge, columns)
        for n in range(wanted):
            away[i, n] = np.inf
            number[i, n] = len(points)
        limit = most * most
        ring, seen = 0, 0.0
        while seen * seen < limit:
            for row in range(max(a - ring, 0), min(a + ring, rows - 1) + 1):
                inner = a - ring < row < a + ring
                # Of the rows between only the cells at both ends are new.
                step = max(2 * ring, 1) if inner else 1
                for column in range(b - ring, b + ring + 1, step):
                    if not 0 <= column < columns:
                        continue
                    for k in range(starts[row, column], starts[row, column + 1]):
                        j = order[k]
                        dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
                        square = dx * dx + dy * dy + dz * dz
                        if square < limit:
                            n = wanted - 1
                            while n > 0 and away[i, n - 1] > square:
                                away[i, n] = away[i, n - 1]
                                number[i, n] = number[i, n - 1]
                                n -= 1
                            away[i, n] = square
                            number[i, n] = j
                            limit = min(limit, away[i, wanted - 1])
            # So far away is what wasn't looked at.
            seen = min(_beyond(along, a, ring, edge, rows), _beyond(across, b, ring, edge, columns))
            ring += 1
        for n in range(wanted):
            away[i, n] = math.sqrt(away[i, n])
