"""Loops that draw events onto a plane level in base; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _place(rays, rotations, positions, turn, height, cell, places):  # type: ignore[no-untyped-def]
    """Where rays meet the plane of a height in base, in cells of it.

    `rays` are directions in a camera that is turned by `turn`, shape (3, 3), against `rotations`,
    shape (n, 3, 3), its poses' at `positions`, shape (n, 3). `places`, shape (n, 2), receives x
    and y.
    """
    t00, t01, t02 = turn[0, 0], turn[0, 1], turn[0, 2]
    t10, t11, t12 = turn[1, 0], turn[1, 1], turn[1, 2]
    t20, t21, t22 = turn[2, 0], turn[2, 1], turn[2, 2]
    per = 1 / cell
    for n in range(len(rays)):
        a, b, c = rays[n, 0], rays[n, 1], rays[n, 2]
        x = t00 * a + t01 * b + t02 * c
        y = t10 * a + t11 * b + t12 * c
        z = t20 * a + t21 * b + t22 * c
        r, p = rotations[n], positions[n]
        reach = (height - p[2]) / (r[2, 0] * x + r[2, 1] * y + r[2, 2] * z)
        places[n, 0] = (p[0] + reach * (r[0, 0] * x + r[0, 1] * y + r[0, 2] * z)) * per
        places[n, 1] = (p[1] + reach * (r[1, 0] * x + r[1, 1] * y + r[1, 2] * z)) * per


@njit(cache=True, nogil=True)
def _draw(places, origin, counts):  # type: ignore[no-untyped-def]
    """Count places into the cells of a map that begins at `origin`.

    Returns how many lie on it, and the first and last row and column that any lies in.
    """
    height, width = counts.shape
    count, top, bottom, left, right = 0, height, -1, width, -1
    for n in range(len(places)):
        x, y = places[n, 0] - origin[0], places[n, 1] - origin[1]
        # Written so that NaN fails it.
        if 0 <= x < height and 0 <= y < width:
            i, j = int(x), int(y)
            counts[i, j] += np.float32(1)
            count += 1
            top, bottom = min(top, i), max(bottom, i)
            left, right = min(left, j), max(right, j)
    return count, top, bottom, left, right
