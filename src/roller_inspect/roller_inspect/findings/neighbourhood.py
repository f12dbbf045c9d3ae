"""What is measured of a component: its cells, and what lies around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_inspect.height_map.height_map import F32, Bools, HeightMap
from roller_inspect.references.reference import Comparison

from .components import Component
from .cues import Cues, distance

#: Width of the ring around a finding that its depth counts from, m.
RING_M = (3e-4, 1.2e-3)
#: The level around: a tenth of the ring at least lies so near to the reference.
_LEVEL_PERCENT = 10


@dataclass(frozen=True)
class Neighbourhood:
    """A component and its surroundings, cropped from the map."""

    window: tuple[slice, slice]
    part: HeightMap
    #: Of the map.
    step_m: float
    #: From the reference, m; not finite where nothing is known.
    deviation: F32
    #: The component's cells, and those of others.
    mask: Bools
    others: Bools
    #: Of cells, for smoothing.
    weight: F32
    #: Deviation smoothed at the finest scale, m, and where it is known.
    fine: F32
    known: Bools
    #: Beyond the border of what is searched.
    outer: Bools

    @classmethod
    def around(
        cls, component: Component, height_map: HeightMap, comparison: Comparison, cues: Cues,
        margin_m: float,
    ) -> Neighbourhood:  # fmt: skip
        """Of a component, with a margin of the map around it."""
        step = height_map.step_m
        margin = round(margin_m / step) + 2
        window = (
            slice(max(component.rows.start - margin, 0), component.rows.stop + margin),
            slice(max(component.columns.start - margin, 0), component.columns.stop + margin),
        )
        part = height_map.cropped(window[1], window[0])
        deviation = comparison.deviation_m[window]
        mask = component.placed(window[0].start, window[1].start, part.shape)
        fine = cues.fine_m[window]
        return cls(
            window, part, step, deviation, mask, cues.weak[window] & ~mask, cues.weight[window],
            fine, np.isfinite(fine) & part.known, cues.outer[window],
        )  # fmt: skip

    def level_around(self) -> float:
        """Median of the deviation in a ring around the component, m; 0 where little is known."""
        away_m = distance(~self.mask) * self.step_m
        ring = (away_m > RING_M[0]) & (away_m < RING_M[1]) & self.known & ~self.others
        return float(np.median(self.fine[ring])) if ring.sum() >= 20 else 0.0


def ring_around(
    mask: Bools, depth: npt.NDArray[np.floating], step_m: float
) -> tuple[npt.NDArray[np.floating], float]:
    """Depths in a ring around some cells, and the level around; m, infinity where nothing is known.

    Parameters
    ----------
    mask : ndarray of bool, shape (ny, nx)
        The cells.
    depth : ndarray, shape (ny, nx)
        Metres; minus infinity where it isn't known.
    step_m : float
        Edge of a cell.
    """
    away_m = distance(~mask) * step_m
    ring = depth[(away_m > RING_M[0]) & (away_m < RING_M[1]) & np.isfinite(depth)]
    return ring, max(float(np.percentile(ring, _LEVEL_PERCENT)), 0.0) if len(ring) else np.inf
