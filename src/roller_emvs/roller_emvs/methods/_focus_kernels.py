"""Loops over a window's points; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _write(  # type: ignore[no-untyped-def]
    row, column, offset, sure, own_sigma, agreed, middle, half, depth, confidence, sigma
):
    """Put points within the image and the range into images: depths, and what they are sure of."""
    height, width = depth.shape
    for n in range(len(row)):
        i, j = row[n], column[n]
        if i < height and j < width and abs(offset[n]) <= half:
            z = np.float32(1.0 / (middle + offset[n]))
            depth[i, j] = z
            confidence[i, j] = sure[n]
            sigma[i, j] = own_sigma[n] * agreed[n] * (z * z)
