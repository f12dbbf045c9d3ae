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
    #: Where that mean is, from the cell's middle along x and y, in cells; 0 without points. Shape
    #: (2, ny, nx).
    place: F32


def bin_points(x: F64, y: F64, height_m: F64, sigma_m: F64, shape: tuple[int, int]) -> Cells:
    """Put points into cells.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        From the window's corner, in cells; points outside the window are left out.
    height_m, sigma_m : ndarray, shape (n,)
        Height and standard uncertainty, metres.
    shape : (int, int)
        Cells along y and x.
    """
    column, row = np.floor(x), np.floor(y)
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    x, y, column, row = x[inside], y[inside], column[inside], row[inside]
    index = (row * shape[1] + column).astype(np.int64)
    size = shape[0] * shape[1]
    weight = 1.0 / np.maximum(sigma_m[inside], 1e-6) ** 2
    count = np.bincount(index, minlength=size)
    total = np.bincount(index, weight, size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(index, weight * height_m[inside], size) / total
        place = np.array(
            [np.bincount(index, weight * (at - 0.5), size) / total for at in (x - column, y - row)]
        )
        # Points of one cell see the same events: their mean is hardly better than one of them.
        sigma = np.sqrt(count / total) * np.sqrt(1.0 / (1.0 + (count - 1) / _SHARED))
    sigma[count == 0], place[:, count == 0] = np.nan, 0.0
    return Cells(
        mean.reshape(shape).astype(np.float32),
        sigma.reshape(shape).astype(np.float32),
        np.minimum(count, 65535).astype(np.uint16).reshape(shape),
        place.reshape(2, *shape).astype(np.float32),
    )
