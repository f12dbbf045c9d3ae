"""From points to cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from .height_map import F32

#: Errors of neighbouring points come from the same rays: so many count as one.
_SHARED = 3.0


@dataclass(frozen=True)
class Cells:
    """Measured cells of a window: what its points say."""

    #: Weighted mean of the points and its standard uncertainty; NaN without points. Shape (ny, nx).
    height_m: F32
    sigma_m: F32
    #: Points. Shape (ny, nx).
    points: npt.NDArray[np.uint16]


def bin_points(
    column: npt.NDArray[np.int64],
    row: npt.NDArray[np.int64],
    height_m: F64,
    sigma_m: F64,
    shape: tuple[int, int],
) -> Cells:
    """Put points into cells.

    Parameters
    ----------
    column, row : ndarray of int64, shape (n,)
        Cell of each point; those outside the window are left out.
    height_m, sigma_m : ndarray, shape (n,)
        Height and standard uncertainty, metres.
    shape : (int, int)
        Cells along y and x.
    """
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    index = row[inside] * shape[1] + column[inside]
    size = shape[0] * shape[1]
    weight = 1.0 / np.maximum(sigma_m[inside], 1e-6) ** 2
    count = np.bincount(index, minlength=size)
    total = np.bincount(index, weight, size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(index, weight * height_m[inside], size) / total
        # Points of one cell see the same events: their mean is hardly better than one of them.
        sigma = np.sqrt(count / total) * np.sqrt(1.0 / (1.0 + (count - 1) / _SHARED))
    sigma[count == 0] = np.nan
    return Cells(
        mean.reshape(shape).astype(np.float32),
        sigma.reshape(shape).astype(np.float32),
        np.minimum(count, 65535).astype(np.uint16).reshape(shape),
    )
