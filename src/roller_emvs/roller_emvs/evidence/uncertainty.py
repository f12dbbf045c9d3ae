"""How far a point's offset may be off, from the evidence it came from."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from roller_emvs.rays import F32

from ._kernels import CELL_PX
from .field import EvidenceField
from .sweep import Depths

#: What a neighbourhood's peak errs by where its depths agree, pixels of parallax: where a share of
#: the cells around has depths of both polarities, and where hardly one has, as at a scan's ends.
_PEAK_PX, _SOME_SEEN, _ALONE_PX, _ALONE = 0.5, 0.6, 1.0, 0.2
#: Where on a slope a point lies is known to this, px: events are of an edge, and a neighbourhood
#: spans several.
_PLACE_PX = 1.0
#: Where this share of the cells around has depths of both polarities, as under a printed texture,
#: points err by so many times what those scatter, and by this, pixels of parallax. Elsewhere what
#: is around is of the same few edges, and errs alike.
_ALL_SEEN, _SCATTERS, _LEAST_PX = 0.98, 2.0, 0.1
#: Neighbourhood in which cells are around one, cells.
_AROUND_CELLS = 3.0

I64 = npt.NDArray[np.int64]


def seen_around(depths: list[Depths]) -> F32:
    """Share of the cells around each that have a depth, mean of the polarities."""
    known = np.mean([np.isfinite(own.offset) for own in depths], axis=0, dtype=np.float32)
    return np.asarray(cv2.GaussianBlur(known, (0, 0), _AROUND_CELLS), np.float32)


def point_sigma(
    field: EvidenceField, fitted: F32, row: I64, column: I64, scatter_px: F32, seen: F32
) -> F32:
    """Standard uncertainty of the offset of pixels but for drift, float32, shape (n,).

    Depths that scatter about their surface err by what they scatter, in parallax; where the
    surface is steep a point is off by its place besides.

    Parameters
    ----------
    field : EvidenceField
        Events.
    fitted : ndarray of float32, shape (rows, columns)
        Surface on cells.
    row, column : ndarray of int64, shape (n,)
        Pixels.
    scatter_px : ndarray of float32, shape (n,)
        Deviation of the depths around from the surface, pixels of parallax.
    seen : ndarray of float32, shape (rows, columns)
        Share of the cells around that have a depth; see `seen_around`.
    """
    i, j = row // CELL_PX, column // CELL_PX
    peak_px = np.interp(seen, (_ALONE, _SOME_SEEN), (_ALONE_PX, _PEAK_PX))[i, j]
    of_peak = np.hypot(scatter_px, peak_px) / _parallax(field)[j]
    return np.hypot(of_peak, _PLACE_PX * _slope(fitted)[i, j]).astype(np.float32)


def agreed_share(
    field: EvidenceField,
    fitted: F32,
    row: I64,
    column: I64,
    scatter_px: F32,
    seen: F32,
    sigma: F32,
) -> F32:
    """Share of the uncertainty of pixels that is left by how their neighbours agree, 0-1.

    Polarities drift apart, so where both are seen all around, and agree, neither does; then what
    they scatter is what they err by.

    Parameters
    ----------
    field, fitted, row, column, scatter_px, seen
        See `point_sigma`.
    sigma : ndarray of float32, shape (n,)
        Uncertainty of each by itself, drift and all.

    Returns
    -------
    ndarray of float32, shape (n,)
    """
    i, j = row // CELL_PX, column // CELL_PX
    agreed = np.hypot(_SCATTERS * scatter_px, _LEAST_PX) / _parallax(field)[j]
    agreed = np.hypot(agreed, _PLACE_PX * _slope(fitted)[i, j])
    share = np.minimum(agreed / np.maximum(sigma, np.float32(1e-12)), 1.0)
    return np.where(seen[i, j] >= _ALL_SEEN, share, 1.0).astype(np.float32)


def _parallax(field: EvidenceField) -> F32:
    return np.maximum(field.apertures, np.float32(1e-12))


def _slope(fitted: F32) -> F32:
    """Slope by pixel; 0 where it isn't known."""
    down, along = map(np.asarray, np.gradient(fitted))
    return np.asarray(np.nan_to_num(np.hypot(down, along)) / CELL_PX, np.float32)
