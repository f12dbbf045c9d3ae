"""Depths from the images of a block's parts, coarse to fine."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

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

from ._part_kernels import TILE_CELLS
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
        tiles = np.where(field.reached[k][..., None], [0, len(coarse) - 1], [len(coarse), -1])
        parts[k] = field.measure(k, coarse, True, tiles.astype(np.int32), inner)

    if not field.reached.any():
        return [Depths.none(field.cells)] * 2
    share(threads, 2, look_coarsely)
    near = offset_of_parts(sum(p for p in parts if p is not None), coarse)  # type: ignore[arg-type]
    first, last, _ = planes_near(near, at, s)
    searched = _searched(first, last, len(at))

    def look(k: int) -> None:
        tiles = np.where(field.reached[k][..., None], searched, [len(at), -1]).astype(np.int32)
        if (tiles[..., 1] < 0).all():
            found[k] = Depths.none(field.cells)
            return
        found[k] = sharpest(field, field.measure(k, at, False, tiles, inner), at, first, last, k, s)

    share(threads, 2, look)
    return [f for f in found if f is not None]


def _searched(
    first: npt.NDArray[np.int32], last: npt.NDArray[np.int32], planes: int
) -> npt.NDArray[np.int32]:
    """First and last plane of each tile that its cells and those around are searched on."""
    size = 2 * _AROUND_CELLS + 1
    around = np.ones((size, size), np.uint8)
    known = last >= 0
    low = np.where(known, first, planes).astype(np.float32)
    high = np.where(known, last, -1).astype(np.float32)
    low, high = cv2.erode(low, around), cv2.dilate(high, around)
    starts = np.arange(0, first.shape[1], TILE_CELLS)
    tiles = [np.minimum.reduceat(low, starts, axis=1), np.maximum.reduceat(high, starts, axis=1)]
    return np.stack(tiles, axis=-1).astype(np.int32)
