"""How much of an area was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .height_map import CONTINUED, MEASURED, OUTSIDE, Bools, HeightMap


@dataclass(frozen=True)
class Coverage:
    """Shares of an area, 0–1; they add up to 1 unless the area is empty.

    Attributes
    ----------
    measured, continued, unmeasured : float
        Shares.
    area_m2 : float
        The area.
    points_per_mm2 : float
        Measured points over it.
    """

    measured: float
    continued: float
    unmeasured: float
    area_m2: float
    points_per_mm2: float


def coverage_of(height_map: HeightMap, area: Bools | None = None) -> Coverage:
    """Coverage of a map.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    area : ndarray of bool, shape (ny, nx), optional
        What is to be inspected, cells outside the scan among it count as unmeasured; without it
        all that was scanned.
    """
    state = height_map.state
    inside = state != OUTSIDE if area is None else area
    cells = int(inside.sum())
    if not cells:
        return Coverage(0.0, 0.0, 0.0, 0.0, 0.0)
    measured = float((state[inside] == MEASURED).sum()) / cells
    continued = float((state[inside] == CONTINUED).sum()) / cells
    area_m2 = cells * height_map.step_m**2
    points = float(height_map.points[inside].sum(dtype=np.float64))
    return Coverage(
        measured, continued, 1.0 - measured - continued, area_m2, points / area_m2 / 1e6
    )
