"""From points to cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from . import _kernels
from .height_map import F32

#: Errors of neighbouring points come from the same rays: so many count as one.
_SHARED = 3.0
#: No point is surer than this, m.
_LEAST_SIGMA_M = 1e-6


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
    sums, out = np.empty((*shape, 4)), np.empty((2, *shape), np.float32)
    place, count = np.empty((2, *shape), np.float32), np.empty(shape, np.uint16)
    given = (np.ascontiguousarray(v, np.float64) for v in (x, y, height_m, sigma_m))
    _kernels._bin(*given, _LEAST_SIGMA_M, _SHARED, sums, out, place, count)
    return Cells(out[0], out[1], count, place)
