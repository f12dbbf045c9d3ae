"""From depths on a grid to points: the local plane through them, and support by events."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from roller_core.transforms import F64

from ..rays import F32
from ..threads import share
from . import _kernels as kernels
from ._kernels import CELL_PX
from .field import RayField
from .settings import EvidenceSettings
from .sweep import Depths

#: Spread of samples, in cells², below which a slope is not taken from them alone.
_STIFFNESS = 0.05
#: Neighbourhood whose mean a pixel's support must exceed, px.
_AROUND_PX = 35


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
    fitted = fit_planes(depths, s.slope_sigma_px / CELL_PX, s.threads) if s.slope_sigma_px else None
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
        around = cv2.blur(support, (_AROUND_PX, _AROUND_PX))
        gathered[polarity] = (support, around, surface, enlarge(found.confidence))

    share(s.threads, 2, gather)
    best = np.zeros(field.shape, np.float32)
    shift, sure = np.empty_like(best), np.empty_like(best)
    for images in gathered:
        if images is not None:
            kernels._choose(*images, np.float32(max(s.min_votes, 0.5)), best, shift, sure)
    row, column = np.divmod(np.flatnonzero(best > 0), best.shape[1])
    return Relief(row, column, shift[row, column].astype(np.float64), sure[row, column])


def fit_planes(depths: list[Depths], sigma: float, threads: int = 1) -> F32:
    """Surface at every pixel by planes through the depths around it, float32.

    A depth belongs to where its evidence lies, which on a wall is not the cell that it was
    summed for; the slope comes from neighbouring edges. Weights are the root of energy: bright
    edges shouldn't silence faint ones.

    Parameters
    ----------
    depths : list of Depths
        On the grid's cells.
    sigma : float
        Neighbourhood, in cells.
    threads : int
        Threads that share the work.
    """
    shape = depths[0].shift.shape
    moments = np.zeros((9, *shape))
    for found in depths:
        kernels._add_moments(found.shift, found.x, found.y, found.energy, moments)
    summed = np.empty_like(moments)

    def blur(k: int) -> None:
        cv2.GaussianBlur(moments[k], (0, 0), sigma, dst=summed[k])

    share(threads, len(moments), blur)
    w = summed[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        mx, my, mz, xx, xy, yy, xz, yz = (m / w for m in summed[1:])
        xx, yy = xx - mx * mx + _STIFFNESS, yy - my * my + _STIFFNESS
        xy, xz, yz = xy - mx * my, xz - mx * mz, yz - my * mz
        det = xx * yy - xy * xy
        slope_x, slope_y = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
        # Height at the cell's own centre plus slope: linear, so enlarging keeps it.
        cx, cy = np.arange(shape[1])[None, :], np.arange(shape[0])[:, None]
        at_cell = mz + slope_x * (cx - mx) + slope_y * (cy - my)
    at_cell[~(w > 1e-9)] = np.nan
    return enlarge(at_cell.astype(np.float32))


def enlarge(values: F32) -> F32:
    """From cells to pixels, bilinear."""
    size = (values.shape[1] * CELL_PX, values.shape[0] * CELL_PX)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)
