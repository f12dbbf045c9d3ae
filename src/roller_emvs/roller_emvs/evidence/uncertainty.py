"""How far a point's offset may be off, from the evidence it came from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_emvs.rays import F32

from . import _point_kernels as kernels
from .blur import blurred
from .field import EvidenceField
from .sweep import Depths

#: What a neighbourhood's peak errs by where its depths agree: shares of the cells around that have
#: depths of both polarities, hardly one, as at a scan's ends, and some; and what it errs by with
#: either, pixels of parallax.
_PEAK = 0.2, 0.6, 1.0, 0.5
#: Where on a slope a point lies is known to this, px: events are of an edge, and a neighbourhood
#: spans several.
_PLACE_PX = 1.0
#: Where this share of the cells around has depths of both polarities, as under a printed texture,
#: points err by so many times what those scatter, and by this, pixels of parallax. Elsewhere what
#: is around is of the same few edges, and errs alike.
_AGREED = 0.98, 2.0, 0.1
#: Neighbourhood in which cells are around one, cells.
_AROUND_CELLS = 3.0

I64 = npt.NDArray[np.int64]


def seen_around(depths: list[Depths]) -> F32:
    """Share of the cells around each that have a depth, mean of the polarities."""
    known = np.mean([[np.isfinite(own.offset)] for own in depths], axis=0, dtype=np.float32)
    return np.asarray(blurred(np.asarray(known), _AROUND_CELLS)[0])


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
    sigma = np.empty(len(row), np.float32)
    kernels._own_sigma(
        fitted, seen, _parallax(field), row, column, scatter_px, _PEAK, _PLACE_PX, sigma
    )
    return sigma


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
    share = np.empty(len(row), np.float32)
    kernels._agreed(
        fitted, seen, _parallax(field), row, column, scatter_px, _AGREED, _PLACE_PX, sigma, share
    )
    return share


def _parallax(field: EvidenceField) -> F32:
    return np.maximum(field.apertures, np.float32(1e-12))
