"""How much a map scatters, as it shows itself: for where points say less than they claim."""

from __future__ import annotations

import numpy as np

from .height_map import F32, Bools
from .medians import block_medians, median_around, spread_blocks

#: Distance of the cells that are compared, m; errors of points are alike over some 0.3 mm.
_LAG_M = 5e-4
#: Blocks that a spread is taken of, m, and fewest cells in one.
_BLOCK_M, _LEAST_CELLS = 1.5e-3, 40
#: Median of the least of four third differences of normal errors of standard deviation 1.
_MEDIAN = 0.9
_COEFFICIENTS = (-1.0, 3.0, -3.0, 1.0)


def scatter_of(height_m: F32, measured: Bools, step_m: float) -> F32:
    """Standard deviation of heights around a smooth surface, by place.

    Third differences know neither slope nor curvature; the least of four directions runs along a
    wall or an edge, not across it.

    Parameters
    ----------
    height_m : ndarray of float32, shape (ny, nx)
        All cells, those between measured ones completed.
    measured : ndarray of bool, shape (ny, nx)
        Cells that count.
    step_m : float
        Edge of a cell, metres.

    Returns
    -------
    ndarray of float32, shape (ny, nx)
        Metres; NaN where too few cells were measured to say.
    """
    lag = max(1, round(_LAG_M / step_m))
    padded = np.pad(height_m, 2 * lag, mode="reflect" if min(height_m.shape) > 2 * lag else "edge")
    ny, nx = height_m.shape
    least = np.full(height_m.shape, np.inf, np.float32)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        total = np.zeros(height_m.shape, np.float32)
        for k, c in enumerate(_COEFFICIENTS):
            i, j = (2 + (k - 1) * dy) * lag, (2 + (k - 1) * dx) * lag
            total += np.float32(c) * padded[i : i + ny, j : j + nx]
        np.minimum(least, np.abs(total), out=least)
    return _by_block(least, measured, max(1, round(_BLOCK_M / step_m)))


def _by_block(values: F32, measured: Bools, k: int) -> F32:
    """Median by block, then of three by three blocks; none where little was measured."""
    median = block_medians(values, measured, k, _LEAST_CELLS)
    out = np.where(np.isfinite(median), median_around(median, 1), np.nan) / _MEDIAN
    return spread_blocks(out, k, values.shape).astype(np.float32)
