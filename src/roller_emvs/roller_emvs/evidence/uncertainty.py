"""How far a point's offset may be off, from the evidence it came from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_emvs.rays import F32

from ._kernels import CELL_PX
from .field import EvidenceField

#: What a neighbourhood's peak errs by where its depths agree, pixels of parallax.
_PEAK_PX = 0.5
#: Where on a slope a point lies is known to this, px: events are of an edge, and a neighbourhood
#: spans several.
_PLACE_PX = 1.0

I64 = npt.NDArray[np.int64]


def point_sigma(field: EvidenceField, fitted: F32, row: I64, column: I64, scatter_px: F32) -> F32:
    """Standard uncertainty of the offset of pixels, float32, shape (n,).

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
    """
    i, j = row // CELL_PX, column // CELL_PX
    down, along = map(np.asarray, np.gradient(fitted))
    slope = np.nan_to_num(np.hypot(down[i, j], along[i, j])) / CELL_PX
    parallax = np.maximum(field.apertures[j], np.float32(1e-12))
    of_peak = np.hypot(scatter_px, _PEAK_PX) / parallax
    return np.hypot(of_peak, _PLACE_PX * slope).astype(np.float32)
