"""From depths on a grid to points: the local plane through them, and support by events."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from roller_core.transforms import F64

from ..rays import F32
from ..threads import share
from . import _kernels as kernels
from . import _peak_kernels as peaks
from ._kernels import CELL_PX
from .field import RayField
from .fit import fit_planes
from .settings import EvidenceSettings
from .sweep import Depths

#: Neighbourhood whose mean a pixel's support must exceed, cells.
_AROUND = 9
#: Deviation of a depth that is as good as its evidence, pixels of parallax.
_RESOLUTION_PX = 1.0
#: Scatter from which on the depths around a place don't tell one, pixels of parallax.
_MOST_SCATTER_PX = 1.5


@dataclass(frozen=True)
class Relief:
    """Measured pixels of a grid.

    Attributes
    ----------
    row, column : ndarray of int64, shape (n,)
        Pixels.
    shift : ndarray of float64, shape (n,)
        Parameter of the plane that the surface lies on there.
    confidence : ndarray of float32, shape (n,)
        0–1.
    """

    row: np.ndarray
    column: np.ndarray
    shift: F64
    confidence: F32


def measured_pixels(field: RayField, depths: list[Depths], settings: EvidenceSettings) -> Relief:
    """Pixels on which events of one polarity gather, and the surface there.

    Parameters
    ----------
    field : RayField
        Rays.
    depths : list of Depths
        Of OFF and of ON events.
    settings : EvidenceSettings
        `slope_sigma_px` and `min_votes`.
    """
    s = settings
    fitted: F32 | None = None
    if s.slope_sigma_px:
        px_per_shift = max(field.aperture, 1e-12)
        resolution = _RESOLUTION_PX / px_per_shift
        fit = fit_planes(depths, s.slope_sigma_px / CELL_PX, resolution, s.threads)
        fitted = enlarge(fit.shift.astype(np.float32))
    gathered: list[tuple[F32, F32, F32, F32] | None] = [None, None]

    def gather(polarity: int) -> None:
        found = depths[polarity]
        known = np.isfinite(found.shift)
        if not known.any():
            return
        surface = enlarge(found.shift)
        if fitted is not None:
            np.copyto(surface, fitted, where=np.isfinite(surface))
        support = np.zeros(field.shape, np.float32)
        first, last = int(field.bounds[polarity]), int(field.bounds[polarity + 1])
        start = np.float32(np.median(found.shift[known]))
        kernels._warp(field.rays, first, last, surface, start, support)
        gathered[polarity] = (support, _around(support), surface, enlarge(found.confidence))

    share(s.threads, 2, gather)
    best = np.zeros(field.shape, np.float32)
    shift, sure = np.empty_like(best), np.empty_like(best)
    for images in gathered:
        if images is not None:
            peaks._choose(*images, np.float32(max(s.min_votes, 0.5)), best, shift, sure)
    row, column = np.divmod(np.flatnonzero(best > 0), best.shape[1])
    if fitted is not None:
        scatter_px = enlarge((fit.scatter * px_per_shift).astype(np.float32))[row, column]
        scatter_px = np.where(np.isfinite(scatter_px), scatter_px, np.float32(_RESOLUTION_PX))
        agree = scatter_px < _MOST_SCATTER_PX
        row, column, scatter_px = row[agree], column[agree], scatter_px[agree]
        sure[row, column] /= 1.0 + scatter_px**2
    return Relief(row, column, shift[row, column].astype(np.float64), sure[row, column])


def _around(support: F32) -> F32:
    """Mean of the neighbourhood of each pixel."""
    height, width = support.shape
    cells = cv2.resize(support, (width // CELL_PX, height // CELL_PX), interpolation=cv2.INTER_AREA)
    return enlarge(cv2.blur(cells, (_AROUND, _AROUND)))


def enlarge(values: F32) -> F32:
    """From cells to pixels, bilinear."""
    size = (values.shape[1] * CELL_PX, values.shape[0] * CELL_PX)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)
