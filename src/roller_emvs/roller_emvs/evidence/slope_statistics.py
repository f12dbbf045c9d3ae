"""Slopes of the rays that saw each cell: from where it was seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from roller_emvs.rays import F32

from . import _seen_kernels as kernels
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
    grown = np.empty(offset.shape, np.float32)
    kernels._grow(offset, np.empty(len(offset), np.bool_), grown)
    sums = cv2.GaussianBlur(field.slope_sums(grown, polarity), (0, 0), 1.0)
    count, mean, spread = np.empty((3, *offset.shape), np.float32)
    kernels._statistics(sums, count, mean, spread)
    return SlopeStatistics(count, mean, spread)


def crossing_change(field: EvidenceField, seen: SlopeStatistics) -> F32:
    """How fast the edges of cells gain contrast while they cross the image, by unit of slope.

    More contrast crosses more thresholds, so events get denser on one side of the aperture: by
    (mean of the slopes - middle) / variance of an even spread. An edge's path on its flank grows
    as the root of the thresholds that it crosses, which this is multiplied by.
    """
    low, high = field.slopes * field.ray_slope_scale
    middle, spread = 0.5 * (low + high), np.maximum(np.abs(high - low), 1e-9)
    change = np.empty(seen.count.shape, np.float32)
    # A pixel that waits for its read-out is blind: the denser the events, the more are lost. An
    # edge that is seen from one side alone doesn't say how fast its contrast changes.
    kernels._change(
        seen.count, seen.mean, middle, spread, field.ray_slope_scale, (_ENOUGH, _STEEP),
        CELL_PX * field.focal_px, (field.speed_px_s * _READOUT_S, _MOST_BLIND), change,
    )  # fmt: skip
    return change
