"""Loops over points for what they are unsure of; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from ._kernels import CELL_PX


@njit(cache=True, nogil=True)
def _step(n, i, before, here, after):  # type: ignore[no-untyped-def]
    """Slope at place `i` of `n` from the values around; one-sided at the ends."""
    if i == 0:
        return after - here
    if i == n - 1:
        return here - before
    return (after - before) * np.float32(0.5)


@njit(cache=True, nogil=True)
def _slope(fitted, i, j):  # type: ignore[no-untyped-def]
    """Slope of a surface on cells, by pixel, in a cell; 0 where it isn't known."""
    height, width = fitted.shape
    here = fitted[i, j]
    up, below = fitted[max(i - 1, 0), j], fitted[min(i + 1, height - 1), j]
    left, right = fitted[i, max(j - 1, 0)], fitted[i, min(j + 1, width - 1)]
    down = _step(height, i, up, here, below)
    along = _step(width, j, left, here, right)
    slope = np.sqrt(down * down + along * along)
    return slope * np.float32(1.0 / CELL_PX) if slope == slope else np.float32(0)


@njit(cache=True, nogil=True, error_model="numpy")
def _own_sigma(fitted, seen, parallax, row, column, scatter, peak, place, sigma):  # type: ignore[no-untyped-def]
    """Uncertainty of pixels from the scatter around them and the slope there.

    `fitted` and `seen` are on cells, `parallax` by column of them. `peak` holds two shares of what
    is seen and the scatter of a peak there, between which it goes linearly; `place` is how far
    beside it a pixel may lie.
    """
    few, some, alone, among = (
        np.float32(peak[0]), np.float32(peak[1]), np.float32(peak[2]), np.float32(peak[3])
    )  # fmt: skip
    per_share = (among - alone) / (some - few)
    beside = np.float32(place)
    for n in range(len(row)):
        i, j = row[n] // CELL_PX, column[n] // CELL_PX
        share = min(max(seen[i, j], few), some) - few
        errs = alone + share * per_share
        of_peak = np.sqrt(scatter[n] * scatter[n] + errs * errs) / parallax[j]
        of_place = beside * _slope(fitted, i, j)
        sigma[n] = np.sqrt(of_peak * of_peak + of_place * of_place)


@njit(cache=True, nogil=True, error_model="numpy")
def _agreed(fitted, seen, parallax, row, column, scatter, limits, place, sigma, share):  # type: ignore[no-untyped-def]
    """Share of the uncertainty of pixels that is left by how those around agree; see `_own_sigma`.

    `limits`: what must be seen around, how many times what they scatter they err by, and that at
    least.
    """
    most_seen, times, least = np.float32(limits[0]), np.float32(limits[1]), np.float32(limits[2])
    beside, one = np.float32(place), np.float32(1)
    for n in range(len(row)):
        i, j = row[n] // CELL_PX, column[n] // CELL_PX
        share[n] = one
        if seen[i, j] >= most_seen:
            scatters = times * scatter[n]
            of_peak = np.sqrt(scatters * scatters + least * least) / parallax[j]
            of_place = beside * _slope(fitted, i, j)
            agreed = np.sqrt(of_peak * of_peak + of_place * of_place)
            share[n] = min(agreed / max(sigma[n], np.float32(1e-12)), one)
