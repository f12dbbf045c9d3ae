"""Taking out of depth what edges creep along the surface under a light that travels along.

A pixel's event tells that brightness has changed by a threshold since the last one. Where the
sensor comes upon a wall that looks darker than the flat surface before it, that happens a share
threshold / contrast down the wall's flank. Ring light and camera travel together, so a wall that
leans away from them grows darker while it crosses the image, and the place creeps: a feature that
moves along the surface looks nearer or farther than it is. Where the wall ends brightness is back
at what it was, whatever the contrast, and nothing creeps.

How contrast changes shows in the events themselves: more contrast crosses more thresholds, so
events get denser on one side of the aperture. With the rays' lean s, the relative change of
density is (mean(s) - middle) / variance of an even spread. The way along the flank grows with the
number of thresholds crossed; the factor was fitted on the virtual cell (six objects, 0.1-0.5 m/s)
and means nothing where contrast is steady: there the correction is zero.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..rays import F32
from . import _kernels as kernels
from ._kernels import CELL_PX
from .field import RayField
from .settings import EvidenceSettings

if TYPE_CHECKING:
    from .sweep import Depths

#: Relative change of contrast, per unit of lean, beyond which edges are seen from one side alone
#: and density no longer tells the rate of change.
_STEEP = 2.0
#: Width over which an edge's events lie, px.
_EDGE_PX = 1.0
#: Largest share of time that a pixel is taken to be blind.
_MOST_BLIND = 0.7


def without_creep(
    field: RayField, depths: list[Depths], settings: EvidenceSettings
) -> list[Depths]:
    """Depths of OFF and ON events with the creep of one of them taken out.

    Parameters
    ----------
    field : RayField
        Rays.
    depths : list of Depths
        Of OFF and of ON events.
    settings : EvidenceSettings
        `creep_m` and `creep_polarity`.
    """
    if settings.creep_m == 0:
        return depths
    polarity = settings.creep_polarity
    out = list(depths)
    depth_m = creep_depth_m(field, depths[polarity].shift, polarity, settings.dead_time_s)
    depth_m *= settings.creep_m * field.shift_per_m
    shift = depths[polarity].shift + depth_m.astype(np.float32)
    out[polarity] = replace(depths[polarity], shift=shift)
    return out


def creep_depth_m(field: RayField, shift: F32, polarity: int, dead_time_s: float) -> F32:
    """Depth to add for each metre of creep, by cell."""
    first, last = int(field.bounds[polarity]), int(field.bounds[polarity + 1])
    count, slope = np.zeros(field.cells, np.float32), np.zeros(field.cells, np.float32)
    known = np.isfinite(shift)
    if not known.any():
        return count
    start = np.float32(np.median(shift[known]))
    kernels._meet(field.rays, first, last, _grown(shift), start, count, slope)
    count, slope = (cv2.GaussianBlur(a, (0, 0), 1.0) for a in (count, slope))
    enough = count > 1
    mean = np.where(enough, slope / np.maximum(count, 1e-9), 0.0) * field.lean_per_slope
    low, high = field.slopes * field.lean_per_slope
    middle, spread = 0.5 * (low + high), np.maximum(np.abs(high - low), 1e-9)
    change = np.where(enough, (mean - middle) / (spread**2 / 12), 0.0)
    change /= 1.0 + (change / _STEEP) ** 2
    # Thresholds crossed at an edge: events by row and by image column that saw it.
    crossed = count / (CELL_PX * field.focal_px * spread)
    # A pixel that waits for its read-out is blind: the denser the events, the more are lost.
    blind = np.minimum(crossed / _EDGE_PX * field.speed_px_s * dead_time_s, _MOST_BLIND)
    change, crossed = change / (1.0 - blind), crossed / (1.0 - blind)
    return np.asarray(-np.sqrt(crossed) * change, np.float32)


def _grown(shift: F32) -> F32:
    """Shifts of cells, and next to them the mean of their neighbours."""
    known = np.isfinite(shift)
    weight = cv2.blur(known.astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(known, shift, 0).astype(np.float32), (3, 3))
    grown = np.where(weight > 0, mean / np.maximum(weight, 1e-9), np.nan)
    return np.where(known, shift, grown).astype(np.float32)
