"""Depths from the images of a block's parts, coarse to fine."""

from __future__ import annotations

import numpy as np

from roller_emvs.evidence import (
    Depths,
    EvidenceSettings,
    coarse_planes,
    measure_of_spots,
    offset_of_parts,
    plane_offsets,
    planes_near,
    sharpest,
)
from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _sharpness_kernels as kernels
from .part_field import COARSE_PARTS, PartField

#: Cells by which what is searched around a cell is searched too, as evidence is summed over them.
_AROUND_CELLS = 3
#: Spots, of one vote in each part, below whose focus measure nothing is searched: the fewest that
#: make a peak (`sweep._SPOTS`), of which every other row is looked at.
_SPOTS = 4


def find_coarsely(
    field: PartField, half_m: float, settings: EvidenceSettings, threads: int = 1
) -> F32:
    """Offset on cells between -half_m and half_m on which four parts of the aperture agree.

    Each for itself; NaN where there is none.
    """
    coarse = coarse_planes(field, -half_m, half_m, COARSE_PARTS, settings.planes_per_px)
    inner = max(threads // 2, 1)
    parts: list[F32 | None] = [None, None]

    def look(k: int) -> None:
        tiles = np.zeros((*field.reached[k].shape, 2), np.int32)
        tiles[..., 1] = np.where(field.reached[k], np.int32(len(coarse) - 1), np.int32(-1))
        parts[k] = field.measure(k, coarse, True, tiles, inner)

    if not field.reached.any():
        return np.full(field.cells, np.float32(np.nan))
    share(threads, 2, look)
    total = sum(p for p in parts if p is not None)
    weakest = measure_of_spots(_SPOTS * COARSE_PARTS, 1.0)
    return offset_of_parts(total, coarse, weakest)  # type: ignore[arg-type]


def find_part_depths(
    field: PartField, near: F32, half_m: float, settings: EvidenceSettings, threads: int = 1
) -> list[Depths]:
    """Depth on the grid's cells of OFF and of ON events, between offsets of -half_m and half_m.

    Coarse to fine, as `find_depths`: the whole aperture is searched around the offsets `near`, as
    of `find_coarsely`.
    """
    s = settings
    at = plane_offsets(-half_m, half_m, field.aperture * 2 * half_m, s.planes_per_px)
    inner = max(threads // 2, 1)
    found: list[Depths | None] = [None, None]
    first, last, _ = planes_near(near, at, s)

    def look(k: int) -> None:
        own, tiles = np.empty((2, *field.reached[k].shape, 2), np.int32)
        kernels._tiles_around(first, last, field.reached[k], _AROUND_CELLS, len(at), own, tiles)
        if (tiles[..., 1] < 0).all():
            found[k] = Depths.none(field.cells)
            return
        found[k] = sharpest(field, field.measure(k, at, False, tiles, inner), at, first, last, k, s)

    share(threads, 2, look)
    return [f for f in found if f is not None]
