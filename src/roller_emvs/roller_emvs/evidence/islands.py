"""Small parts of the surface that lie far above or below what is around them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from . import _peak_kernels as peaks
from ._kernels import CELL_PX
from .field import EvidenceField
from .sweep import Depths

#: From cell to cell no skin is this steep; islands of at most so many cells are of chance, if none
#: of them has this share of the confidence of what is around, cells.
_STEEP, _CELLS, _WEAK, _AROUND = 5.0, 24, 0.5, (7, 7)
#: Searched everywhere, a place beside an edge has a depth on which the edge's fringe reaches it: of
#: this share of the evidence on the surface so near, cells, an island is of nothing else.
_FAINT, _BESIDE = np.float32(0.05), (9, 9)
#: A step of that is so many units of the heights that OpenCV takes.
_UNITS = 40
#: Height of a cell without a depth.
_NOWHERE = -32768


def without_islands(field: EvidenceField, depths: Depths, everywhere: bool = False) -> Depths:
    """Depths without the few, weak cells that a jump parts from the others around.

    Wrong peaks that are alike in some neighbouring cells would pass for a surface, millimetres off.
    Few cells with nothing around them stay.

    Parameters
    ----------
    field : EvidenceField
        Events.
    depths : Depths
        Of one polarity.
    everywhere : bool
        Whether they were searched for on all planes, so that some are of fringes.
    """
    per_jump = abs(_STEEP * CELL_PX / field.slope_per_px)
    heights = np.empty(depths.offset.shape, np.int16)
    if not peaks._heights(depths.offset, _UNITS / per_jump, _NOWHERE, heights):
        return depths
    known = heights != _NOWHERE
    cv2.filterSpeckles(heights, _NOWHERE, _CELLS, _UNITS)
    large = heights != _NOWHERE
    small = known != large
    if not small.any():
        return depths
    sure, one = depths.confidence, np.float32(1)
    sums = [cv2.boxFilter(v, -1, _AROUND, normalize=False) for v in (large * sure, large * one)]
    count, label = cv2.connectedComponents(small.astype(np.uint8))
    there = np.nonzero(small)
    number = label[there]
    # Of each island the most that a cell has over the share of what is around it; below 0 it goes.
    over = np.full(count, -np.inf, np.float32)
    around = sums[0][there] / np.maximum(sums[1][there], one)
    np.maximum.at(over, number, sure[there] - _WEAK * around)
    if everywhere:
        own = depths.focus_measure
        most = cv2.dilate(own * large, np.ones(_BESIDE, np.uint8))
        beyond = np.full(count, -np.inf, np.float32)
        np.maximum.at(beyond, number, own[there] - _FAINT * most[there])
        over = np.minimum(over, beyond)
    offset = depths.offset.copy()
    offset[there] = np.where(over[number] < 0, np.float32(np.nan), offset[there])
    return replace(depths, offset=offset)
