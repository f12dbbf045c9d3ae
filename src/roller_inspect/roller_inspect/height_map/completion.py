"""The surface between measured cells."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator

from .height_map import F32


def linear(height_m: F32) -> F32:
    """Linear interpolation between measured cells, the nearest beyond their hull.

    Parameters
    ----------
    height_m : ndarray of float32, shape (ny, nx)
        Measured cells, NaN elsewhere.
    """
    known = np.isfinite(height_m)
    if known.all() or not known.any():
        return height_m.copy()
    to_nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    nearest = height_m[tuple(to_nearest)]
    # Cells inside a measured area say nothing of the gaps.
    border = known & ~ndimage.binary_erosion(known, border_value=1)
    rows, columns = np.nonzero(border)
    if len(rows) < 4 or np.ptp(rows) == 0 or np.ptp(columns) == 0:
        return np.asarray(nearest, np.float32)
    gaps = np.nonzero(~known)
    between = LinearNDInterpolator(np.column_stack([rows, columns]), height_m[border])
    out = nearest.astype(np.float32)
    found = between(np.column_stack(gaps))
    out[gaps] = np.where(np.isfinite(found), found, out[gaps])
    return out
