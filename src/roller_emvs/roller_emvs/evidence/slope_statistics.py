"""Slopes of the rays that saw each cell: from where it was seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from roller_emvs.rays import F32

from ._kernels import CELL_PX
from .field import EvidenceField

#: Events a cell from which on their mean slope means something.
_ENOUGH = 1.0
#: Change by unit of slope beyond which it says less; tuned on the virtual cell, as are those below.
_STEEP = 2.0
#: Time that a pixel waits for its read-out, s, and the largest share of time that it is taken to
#: be blind.
_READOUT_S, _MOST_BLIND = 2e-4, 0.65


@dataclass(frozen=True)
class SlopeStatistics:
    """Slopes from which the events of a polarity saw the cells, float32, shape (rows, columns)."""

    #: Events a cell, over a small neighbourhood.
    count: F32
    #: Mean of their slopes, and the width of an even spread of the same variance; 0 without events.
    mean: F32
    spread: F32


def slope_statistics(field: EvidenceField, offset: F32, polarity: int) -> SlopeStatistics:
    """Slopes of the events that meet the surface.

    Parameters
    ----------
    field : EvidenceField
        Events.
    offset : ndarray of float32, shape (rows, columns)
        Surface on cells, NaN where there is none.
    polarity : int
        0 for OFF, 1 for ON events.
    """
    sums = field.slope_sums(_grown(offset), polarity)
    count, slope, square = cv2.split(cv2.GaussianBlur(sums, (0, 0), 1.0))
    each = np.where(count > 0, 1.0 / np.maximum(count, 1e-9), 0.0).astype(np.float32)
    mean = slope * each
    variance = np.maximum(square * each - mean * mean, 0.0)
    return SlopeStatistics(count, mean, np.sqrt(12.0 * variance))


def crossing_change(field: EvidenceField, seen: SlopeStatistics) -> F32:
    """How fast the edges of cells gain contrast while they cross the image, by unit of slope.

    More contrast crosses more thresholds, so events get denser on one side of the aperture: by
    (mean of the slopes - middle) / variance of an even spread. An edge's path on its flank grows
    as the root of the thresholds that it crosses, which this is multiplied by.
    """
    low, high = field.slopes * field.ray_slope_scale
    middle, spread = 0.5 * (low + high), np.maximum(np.abs(high - low), 1e-9)
    beside = np.where(seen.count > _ENOUGH, seen.mean * field.ray_slope_scale - middle, 0.0)
    change = beside / (spread**2 / 12)
    # An edge that is seen from one side alone doesn't say how fast its contrast changes.
    change /= 1.0 + (change / _STEEP) ** 2
    crossed = seen.count / (CELL_PX * field.focal_px * spread)
    # A pixel that waits for its read-out is blind: the denser the events, the more are lost.
    seeing = 1.0 - np.minimum(crossed * field.speed_px_s * _READOUT_S, _MOST_BLIND)
    return np.asarray(np.sqrt(crossed / seeing) * change / seeing, np.float32)


def _grown(offset: F32) -> F32:
    """Offsets of cells, and next to them the mean of their neighbours."""
    known = np.isfinite(offset)
    weight = cv2.blur(known.astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(known, offset, 0).astype(np.float32), (3, 3))
    grown = np.where(weight > 0, mean / np.maximum(weight, 1e-9), np.nan)
    return np.where(known, offset, grown).astype(np.float32)
