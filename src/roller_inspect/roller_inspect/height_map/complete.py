"""From measured cells to a map of heights, uncertainties and states."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from .cells import Cells
from .completion import linear
from .height_map import CONTINUED, F32, MEASURED, OUTSIDE, U8, UNMEASURED
from .map_settings import HeightMapSettings

#: A gap between steeper borders isn't gone over, nor one where the completed surface is this far
#: from the nearest measured cell, m.
_STEEP, _FAR_M = 0.5, 1e-4
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
    known = np.isfinite(cells.height_m)
    if not known.any():
        empty = np.full(known.shape, np.nan, np.float32)
        return empty, empty.copy(), np.full(known.shape, OUTSIDE, np.uint8)
    height = linear(cells.height_m)
    distance, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
    distance_m = distance * settings.grid_m
    at_nearest = cells.height_m[tuple(nearest)]
    gy, gx = np.gradient(height, settings.grid_m)
    steep = np.hypot(gx, gy)[tuple(nearest)] > _STEEP
    go_on = (distance_m <= settings.reach_m + 1e-9) & (np.abs(height - at_nearest) <= _FAR_M)
    state = np.where(known, MEASURED, np.where(go_on & ~steep, CONTINUED, UNMEASURED))
    sigma = np.hypot(cells.sigma_m[tuple(nearest)], _SLOPE * distance_m)
    outside = _outside(known)
    state[outside] = OUTSIDE
    height[outside] = np.nan
    sigma[outside] = np.nan
    return height, sigma.astype(np.float32), state.astype(np.uint8)


def _outside(known: np.ndarray) -> np.ndarray:
    """Rows beyond the first and last, columns beyond the first and last that have a point."""
    rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
    out = np.ones(known.shape, bool)
    out[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = False
    return out
