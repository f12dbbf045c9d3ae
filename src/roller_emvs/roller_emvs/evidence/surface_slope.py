"""The surface through depths on a grid: its slope, which way its walls face, and their drift."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import EdgeDriftSettings, edge_drift
from roller_emvs.rays import F32

from ._kernels import CELL_PX
from .blur import blurred
from .field import EvidenceField
from .fit import Fit, fit_planes
from .sweep import Depths

#: Neighbourhood from which the surface's slope is taken, px: where drift is taken out, OFF and ON
#: edges err apart by what is left of it, which more of them average; where there is none, walls are
#: levelled less by the narrower one. Tuned on the virtual cell; three objects of another simulator,
#: light that stands still, err 28 µm with 4 px, 31 with 5. With less, hard cases break promises.
SLOPE_SIGMA_PX, STILL_SIGMA_PX = 5.0, 4.0
#: Deviation of a depth that is as good as its evidence, pixels of parallax.
RESOLUTION_PX = 1.0
#: Neighbourhood of cells that face one side, and mean change of contrast at which that counts in
#: full.
_SIDE_CELLS, _SIDE_CHANGE = 1.5, 0.3
#: Neighbourhood of cells whose specks tell one change of contrast. Tuned on the virtual cell's
#: ring: with 1.5 to 6 plates err by 2 to 4 % less than cell by cell, flanks by up to 7 %.
_SPECK_CELLS = 3.0


def surface_slope(
    field: EvidenceField,
    depths: list[Depths],
    threads: int = 1,
    scattered: bool = True,
    sigma_px: float = SLOPE_SIGMA_PX,
) -> tuple[Fit, F64]:
    """The surface through depths on cells, and its slope dh/dx along the roll; see `fit_planes`."""
    fit = surface_fit(field, depths, sigma_px, threads, scattered)
    along = np.gradient(fit.offset, axis=1)
    slope = np.where(np.isnan(along), np.float32(0), -along / CELL_PX) * field.slope_per_px
    return fit, np.asarray(slope, np.float64)


def surface_fit(
    field: EvidenceField,
    depths: list[Depths],
    sigma_px: float,
    threads: int,
    scattered: bool = True,
    like: Fit | None = None,
) -> Fit:
    """The surface through depths on cells."""
    resolution = RESOLUTION_PX / max(field.aperture, 1e-12)
    return fit_planes(depths, sigma_px / CELL_PX, resolution, threads, scattered, like)


def wall_side(depths: list[Depths]) -> F32:
    """Which side of the light a wall faces, by how its contrast changes: -1 to 1, by cell.

    A wall's foot and its top gain contrast together, in whichever polarity they show: so it is
    taken from both, over a neighbourhood.
    """
    known = [np.isfinite(own.offset).astype(np.float32) for own in depths]
    change = [np.where(k > 0, own.change, 0) for k, own in zip(known, depths, strict=True)]
    sums = blurred(np.stack([sum(change), sum(known)]), _SIDE_CELLS)
    return np.tanh(sums[0] / np.maximum(_SIDE_CHANGE * sums[1], np.float32(1e-9)))


def evened_changes(depths: list[Depths]) -> list[Depths]:
    """Depths of a texture, with the mean change of contrast of the specks around, by polarity."""
    found = []
    for own in depths:
        known = np.isfinite(own.offset)
        sums = np.stack([np.where(known, own.change, 0), known]).astype(np.float32)
        total, count = blurred(sums, _SPECK_CELLS)
        found.append(replace(own, change=total / np.maximum(count, np.float32(1e-9))))
    return found


def without_drift(
    field: EvidenceField, depths: list[Depths], slope: F64, side: F32, drift: EdgeDriftSettings
) -> tuple[list[Depths], F32]:
    """Depths less the drift on the slope of the surface through them, and what may be left.

    The latter of each polarity, shape (2, rows, columns).
    """
    known = np.logical_or.reduce([np.isfinite(own.offset) for own in depths])
    found, unsure = [], np.zeros((2, *field.cells), np.float32)
    for polarity, own in enumerate(depths):
        of_cells = slope[known], own.change[known], side[known]
        height, sigma = edge_drift(drift, polarity, *of_cells, field.speed_m_s)
        # Heights count towards the camera, offsets away from it.
        offset = own.offset.copy()
        offset[known] += (height * field.offset_per_m).astype(np.float32)
        found.append(replace(own, offset=offset))
        unsure[polarity][known] = sigma * abs(field.offset_per_m)
    return found, unsure
