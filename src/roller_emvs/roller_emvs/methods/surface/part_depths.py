"""Depths from the images of a block's parts, coarse to fine."""

from __future__ import annotations

import numpy as np

from roller_emvs.evidence import (
    Depths,
    EvidenceSettings,
    coarse_planes,
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


def find_part_depths(
    field: PartField, half_m: float, settings: EvidenceSettings, threads: int = 1
) -> list[Depths]:
    """Depth on the grid's cells of OFF and of ON events, between offsets of -half_m and half_m.

    Coarse to fine, as `find_depths`: where four parts of the aperture agree, each for itself, the
    whole aperture is searched.
    """
    s = settings
    at = plane_offsets(-half_m, half_m, field.aperture * 2 * half_m, s.planes_per_px)
    coarse = coarse_planes(field, -half_m, half_m, COARSE_PARTS, s.planes_per_px)
    inner = max(threads // 2, 1)
    parts: list[F32 | None] = [None, None]
    found: list[Depths | None] = [None, None]

    def look_coarsely(k: int) -> None:
        tiles = np.zeros((*field.reached[k].shape, 2), np.int32)
        tiles[..., 1] = np.where(field.reached[k], np.int32(len(coarse) - 1), np.int32(-1))
        parts[k] = field.measure(k, coarse, True, tiles, inner)

    if not field.reached.any():
        return [Depths.none(field.cells)] * 2
    share(threads, 2, look_coarsely)
    near = offset_of_parts(sum(p for p in parts if p is not None), coarse)  # type: ignore[arg-type]
    first, last, _ = planes_near(near, at, s)

    def look(k: int) -> None:
        tiles = np.empty((*field.reached[k].shape, 2), np.int32)
        kernels._tiles_around(first, last, field.reached[k], _AROUND_CELLS, len(at), tiles)
        if (tiles[..., 1] < 0).all():
            found[k] = Depths.none(field.cells)
            return
        found[k] = sharpest(field, field.measure(k, at, False, tiles, inner), at, first, last, k, s)

    share(threads, 2, look)
    return [f for f in found if f is not None]
