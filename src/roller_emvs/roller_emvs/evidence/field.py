"""Rays on a grid of pixels, in the form that evidence is summed from.

A ray meets the plane of parameter `offset` at pixel (x, y) + offset · (slope_x, slope_y). In a
reference view the parameter is inverse depth, in a strip on the surface it is height; both are
linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.rays import F32

from ._kernels import CELL_PX


@dataclass(frozen=True)
class RayField:
    """Rays in pixels of a grid, x along the parallax.

    Attributes
    ----------
    rays : ndarray of float32, shape (n, 4)
        x, y on the plane of offset 0, px, and slopes, px by unit of offset; OFF events first.
    bounds : ndarray of int64, shape (3,)
        Where OFF and ON events begin, and the end.
    shape : tuple of int
        Rows and columns of the grid, px; multiples of `CELL_PX`.
    slopes : ndarray of float64, shape (2, columns of cells)
        Least and most slope along x from which each column was in view.
    ray_slope_scale : float
        From a slope to the ray's slope dx/dz at the surface.
    offset_per_m : float
        From metres of depth, away from the camera, to the offset.
    focal_px : float
        Focal length, px.
    speed_px_s : float
        Speed of the surface through the image, px/s.
    """

    rays: F32
    bounds: npt.NDArray[np.int64]
    shape: tuple[int, int]
    slopes: F64
    ray_slope_scale: float
    offset_per_m: float
    focal_px: float
    speed_px_s: float

    @property
    def cells(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return self.shape[0] // CELL_PX, self.shape[1] // CELL_PX

    @property
    def aperture(self) -> float:
        """Most spread of slopes of any column: pixels of parallax by unit of offset."""
        return float(max((self.slopes[1] - self.slopes[0]).max(), 0.0))

    @property
    def middles(self) -> F64:
        """Middle of the slopes that each column of cells was seen with; 0 where it never was."""
        low, high = self.slopes
        return np.where(high > low, 0.5 * (low + high), 0.0)

    @property
    def apertures(self) -> F32:
        """Spread of slopes of each column of cells, float32."""
        return np.maximum(self.slopes[1] - self.slopes[0], 0.0).astype(np.float32)
