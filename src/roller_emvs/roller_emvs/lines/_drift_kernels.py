"""The loop over edges that tells their drift; it has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _drift(slope, change, side, beta, beyond, table, max_slope, shares, height, sigma):  # type: ignore[no-untyped-def]
    """Height by which edges are found too high, and its uncertainty; see `edge_drift`.

    `beta` holds the coefficients of all edges or of each, shape (1 or n, 4), `beyond` how far their
    speed is beyond the calibrated ones, shape (1 or n,). `table`, shape (2, bins), is what a
    calibration leaves over on rising and falling slopes, bins from 0 to `max_slope`. `shares`: the
    slope at which its sign counts in full, what stays uncertain of a correction, and what is added
    by unit of slope, or of the speed's logarithm, beyond those calibrated.
    """
    turn, doubt, further = shares
    bins = table.shape[1]
    for n in range(len(slope)):
        b = beta[n if len(beta) > 1 else 0]
        steep = abs(slope[n])
        turned = np.tanh(min(max(slope[n], -max_slope), max_slope) / turn)
        drift = change[n] * b[0] + turned * b[1] + abs(turned) * b[2] + side[n] * b[3]
        # Between the bins' middles; written so that NaN fails it.
        at = steep / max_slope * bins - 0.5
        at = min(at, bins - 1.0) if at > 0.0 else 0.0
        k = min(int(at), bins - 2)
        row = table[0 if slope[n] >= 0 else 1]
        left = row[k] + (at - k) * (row[k + 1] - row[k])
        # A line that shows neither slope nor side may be on a wall all the same.
        unseen = max(abs(b[1] * (1.0 - abs(turned))), abs(b[3] * (1.0 - abs(np.float64(side[n])))))
        square = left**2 + unseen**2 + (doubt * drift) ** 2
        over = further * max(steep - max_slope, 0.0)
        square += (over * max(abs(drift), np.sqrt(square))) ** 2
        over = further * beyond[n if len(beyond) > 1 else 0]
        square += (over * max(abs(drift), np.sqrt(square))) ** 2
        height[n] = drift
        sigma[n] = np.sqrt(square)
