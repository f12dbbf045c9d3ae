"""From depths on a grid to points: the local plane through them, and support by events."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from roller_core.transforms import F64

from ..rays import F32
from . import _kernels
from ._kernels import GRID_PX
from .evidence import BlockRays, Depths
from .surface_settings import SurfaceSettings

#: Spread of samples, in cells², below which a slope is not taken from them alone.
_STIFFNESS = 0.05


@dataclass(frozen=True)
class Relief:
    """Measured pixels of a block: rows, columns, shift from the middle plane (m), confidence."""

    row: F64
    column: F64
    shift: F64
    confidence: F32


def measured_pixels(block: BlockRays, depths: list[Depths], settings: SurfaceSettings) -> Relief:
    """Pixels on which events of one polarity gather, and the surface there."""
    s = settings
    fitted = fit_planes(depths, s.slope_sigma_px / GRID_PX) if s.slope_sigma_px else None
    best = np.zeros(block.shape, np.float32)
    shift = np.full(block.shape, np.nan, np.float32)
    confidence = np.zeros(block.shape, np.float32)
    for bounds, found in zip(block.bounds, depths, strict=True):
        own = _enlarge(found.shift)
        surface = own if fitted is None else np.where(np.isnan(own), np.nan, fitted)
        if np.isnan(surface).all():
            continue
        surface = surface.astype(np.float32)
        support = np.zeros(block.shape, np.float32)
        start = np.float32(np.nanmedian(surface))
        _kernels._warp(block.rays, int(bounds[0]), int(bounds[-1]), surface, start, support)
        around = cv2.GaussianBlur(support, (0, 0), 10.0)
        keep = (support >= s.min_votes) & (support > around) & (support > best)
        keep &= np.isfinite(surface)
        best[keep] = support[keep]
        shift[keep] = surface[keep]
        confidence[keep] = _enlarge(found.confidence)[keep]
    row, column = np.nonzero(best)
    return Relief(
        row.astype(np.float64),
        column.astype(np.float64),
        shift[row, column].astype(np.float64),
        confidence[row, column],
    )


def fit_planes(depths: list[Depths], sigma: float) -> F32:
    """Surface at every pixel by planes through the depths around it, float32.

    A depth belongs to where its evidence lies, which on a wall is not the cell that it was
    summed for; the slope comes from neighbouring edges. Weights are the fourth root of energy:
    bright edges shouldn't silence faint ones.

    Parameters
    ----------
    depths : list of Depths
        On the grid's cells.
    sigma : float
        Neighbourhood, in cells.
    """
    shape = depths[0].shift.shape
    moments = np.zeros((9, *shape))
    for found in depths:
        ok = np.isfinite(found.shift) & (found.energy > 0)
        z, x, y = (v[ok].astype(np.float64) for v in (found.shift, found.x, found.y))
        w = found.energy[ok].astype(np.float64) ** 0.25
        i = np.clip(np.rint(y).astype(np.int64), 0, shape[0] - 1)
        j = np.clip(np.rint(x).astype(np.int64), 0, shape[1] - 1)
        terms = (np.ones_like(z), x, y, z, x * x, x * y, y * y, x * z, y * z)
        for moment, term in zip(moments, terms, strict=True):
            np.add.at(moment, (i, j), w * term)
    summed = [cv2.GaussianBlur(m, (0, 0), sigma) for m in moments]
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
    return _enlarge(at_cell.astype(np.float32))


def _enlarge(values: F32) -> F32:
    """From cells to pixels, bilinear."""
    size = (values.shape[1] * GRID_PX, values.shape[0] * GRID_PX)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)
