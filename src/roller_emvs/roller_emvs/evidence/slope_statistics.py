"""Slopes of the rays that saw each cell: from where it was seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from roller_emvs.rays import F32

from .field import EvidenceField


@dataclass(frozen=True)
class SlopeStatistics:
    """Slopes from which the events of a polarity saw the cells, float32, shape (rows, columns).

    Attributes
    ----------
    count : ndarray
        Events a cell, over a small neighbourhood.
    mean, spread : ndarray
        Mean of their slopes, and the width of an even spread of the same variance; 0 without
        events.
    """

    count: F32
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


def _grown(offset: F32) -> F32:
    """Offsets of cells, and next to them the mean of their neighbours."""
    known = np.isfinite(offset)
    weight = cv2.blur(known.astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(known, offset, 0).astype(np.float32), (3, 3))
    grown = np.where(weight > 0, mean / np.maximum(weight, 1e-9), np.nan)
    return np.where(known, offset, grown).astype(np.float32)
