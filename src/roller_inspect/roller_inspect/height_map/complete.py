"""From measured cells to a map of heights, uncertainties and states."""

from __future__ import annotations

import cv2
import numpy as np

from .cells import Cells
from .completion import at_middles, complete_surface
from .gaps import hold_gaps
from .height_map import CONTINUED, F32, MEASURED, OUTSIDE, U8, UNMEASURED, Bools
from .map_settings import HeightMapSettings
from .nearest import distance_to, nearest_known
from .scanned import outside_scan
from .scatter import scatter_of

#: A gap between steeper borders isn't gone over, nor one where the completed surface is this far
#: from the nearest measured cell, m.
_STEEP, _FAR_M = 0.5, 1e-4
#: A cell this far from the surface that the others make is an outlier, m, and in its σ.
_OUTLIER_M, _OUTLIER_SIGMAS = 1e-4, 3.0
#: Where points are dense, nothing is called measured that scatters more, or is less certain, than
#: this, m: a wrong height is one that is off by 100 µm. A lone edge is good for more.
_MOST_SCATTER_M, _MOST_SIGMA_M, _MOST_SIGMA_SPARSE_M, _LEAST_NOISY_M = 5e-5, 1e-4, 1.5e-4, 3e-3
#: What a continued cell adds to its neighbours' uncertainty by distance.
_SLOPE = 0.1


def complete(cells: Cells, settings: HeightMapSettings) -> tuple[F32, F32, U8]:
    """Heights, standard uncertainties and states of a window.

    Returns
    -------
    height_m, sigma_m : ndarray of float32, shape (ny, nx)
        Metres; NaN outside the scan. Unmeasured cells carry a guess.
    state : ndarray of uint8, shape (ny, nx)
    """
    step = settings.grid_m
    known = np.isfinite(cells.height_m)
    if not known.any():
        empty = np.full(known.shape, np.nan, np.float32)
        return empty, empty.copy(), np.full(known.shape, OUTSIDE, np.uint8)
    outside = outside_scan(known, step)
    height = complete_surface(cells.height_m, cells.sigma_m, step, cells.place)
    measured = at_middles(height, cells.height_m, cells.place, step)
    hold_gaps(height, measured, outside)
    with np.errstate(invalid="ignore"):
        away = np.abs(measured - height)
        good = known & (away < np.maximum(_OUTLIER_M, _OUTLIER_SIGMAS * cells.sigma_m))
    # Of the cells as measured: the completed surface has the noise smoothed away.
    near = nearest_known(good) if good.any() else np.zeros(good.shape, np.intp)
    scatter = scatter_of(measured.ravel()[near], good, step)
    dense = np.isfinite(scatter)
    noisy = dense & ((scatter > _MOST_SCATTER_M) | (_local(cells, good) > _MOST_SIGMA_M))
    # Walls around a hollow scatter too; what is no larger than it, m, is no noise.
    size = max(1, round(_LEAST_NOISY_M / step))
    noisy = cv2.morphologyEx(noisy.astype(np.uint8), cv2.MORPH_OPEN, np.ones((size, size))) > 0
    good &= ~noisy & (cells.sigma_m <= _MOST_SIGMA_SPARSE_M)
    if not good.any():
        state = np.where(outside, OUTSIDE, UNMEASURED).astype(np.uint8)
        return np.where(outside, np.nan, height), np.full(known.shape, np.nan, np.float32), state
    at = nearest_known(good)
    distance = distance_to(at)
    gy, gx = np.gradient(height, step)
    level = np.asarray(gx * gx + gy * gy <= _STEEP**2)
    go_on = (distance * step <= settings.reach_m + 1e-9) & ~noisy
    # A gap of a cell or two can't hide a wall.
    go_on &= (distance < 2.0) | (
        (np.abs(height - height.ravel()[at]) <= _FAR_M) & level.ravel()[at]
    )
    state = np.where(good, MEASURED, np.where(go_on, CONTINUED, UNMEASURED))
    sigma = np.hypot(np.fmax(cells.sigma_m.ravel()[at], scatter), _SLOPE * distance * step)
    state[outside] = OUTSIDE
    height[outside], sigma[outside] = np.nan, np.nan
    return height, sigma.astype(np.float32), state.astype(np.uint8)


def _local(cells: Cells, good: Bools) -> F32:
    """Mean uncertainty of the measured cells around."""
    size = 15
    total, share = (
        cv2.blur(values, (size, size), borderType=cv2.BORDER_REFLECT)
        for values in (np.where(good, cells.sigma_m, np.float32(0)), good.astype(np.float32))
    )
    return np.asarray(total / np.maximum(share, 1e-6), np.float32)
