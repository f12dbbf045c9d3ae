"""Taking out of depth how far edges drift along the surface under a light that travels along.

A pixel's event says that brightness has changed by a threshold since the last one. Where the
sensor comes upon a wall that looks darker than the flat surface before it, that happens a share
threshold / contrast down the wall's flank. Ring light and camera travel together, so a wall that
leans away from them grows darker while it crosses the image, and the place drifts: a feature that
moves along the surface looks nearer or farther than it is. Where the wall ends brightness is back
at what it was, whatever the contrast, and nothing drifts.

How contrast changes shows in the events themselves: more contrast crosses more thresholds, so
events get denser on one side of the aperture. With the rays' slope s, the relative change of
density is (mean(s) - middle) / variance of an even spread. The path along the flank grows with the
number of thresholds crossed; the factor was fitted on the virtual cell (six objects, 0.1-0.5 m/s)
and means nothing where contrast is steady: there the correction is zero.
"""

from __future__ import annotations

import numpy as np

from roller_emvs.rays import F32

from ._kernels import CELL_PX
from .field import EvidenceField
from .slope_statistics import SlopeStatistics

#: Relative change of contrast, per unit of slope, beyond which edges are seen from one side alone
#: and density no longer tells the rate of change.
_STEEP = 2.0
#: Width over which an edge's events lie, px.
_EDGE_PX = 1.0
#: Largest share of time that a pixel is taken to be blind.
_MOST_BLIND = 0.65
#: Events a cell from which on their mean slope means something.
_ENOUGH = 1.0


def edge_drift_depth_m(field: EvidenceField, seen: SlopeStatistics, dead_time_s: float) -> F32:
    """Depth to add for each metre of drift, by cell.

    Parameters
    ----------
    field : EvidenceField
        Events.
    seen : SlopeStatistics
        Of the events of edges that drift.
    dead_time_s : float
        Time that a pixel is blind after an event, seconds.
    """
    low, high = field.slopes * field.ray_slope_scale
    middle, spread = 0.5 * (low + high), np.maximum(np.abs(high - low), 1e-9)
    beside = np.where(seen.count > _ENOUGH, seen.mean * field.ray_slope_scale - middle, 0.0)
    change = beside / (spread**2 / 12)
    change /= 1.0 + (change / _STEEP) ** 2
    # Thresholds crossed at an edge: events by row and by image column that saw it.
    crossed = seen.count / (CELL_PX * field.focal_px * spread)
    # A pixel that waits for its read-out is blind: the denser the events, the more are lost.
    blind = np.minimum(crossed / _EDGE_PX * field.speed_px_s * dead_time_s, _MOST_BLIND)
    change, crossed = change / (1.0 - blind), crossed / (1.0 - blind)
    return np.asarray(-np.sqrt(crossed) * change, np.float32)
