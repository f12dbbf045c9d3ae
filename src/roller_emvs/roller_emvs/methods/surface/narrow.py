"""Leaving out what holds no evidence of a block once it was looked at coarsely.

Around what lies on a bare plate most of a block is empty, of one that is joined of three lengths
above all. Sums over neighbourhoods, planes through them and images take as long there as elsewhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roller_emvs.evidence import CELL_PX
from roller_emvs.rays import F32

from .blocks import MARGIN_M, Block
from .part_field import PartField

#: Cells around those with a coarse offset whose evidence a depth is summed from, and around that
#: those that tell on the surface there.
_AROUND_CELLS = 4 + 8


def narrowed(
    block: Block, field: PartField, near: F32, pixel_m: float
) -> tuple[Block, PartField, F32]:
    """Block, field and coarse offsets of what is near these; the same where that is most of them.

    Parameters
    ----------
    block : Block
        Rows that are done.
    field : PartField
        Its votes.
    near : ndarray of float32, shape (rows, columns)
        Coarse offset on cells, NaN where there is none.
    pixel_m : float
        Size of the grid's pixels.
    """
    cells = np.isfinite(near)
    # Where there is nothing, anything small will do.
    cells[0, 0] |= not cells.any()
    # A column's evidence is looked for along the middle of the rays that it was seen by.
    moved = int(np.ceil(np.abs(field.middles).max() * field.most_offset / CELL_PX)) + 1
    cut = field.cut_around(cells, _AROUND_CELLS + moved)
    if cut is None:
        return block, field, near
    part, (rows, columns) = cut
    size = CELL_PX * pixel_m
    start_m = block.start_m + columns.start * size
    low_y_m = block.low_y_m + rows.start * size
    end_m = block.end_m
    if columns.stop < field.cells[1]:
        end_m = block.start_m + columns.stop * size - 2 * MARGIN_M
    kept = np.ascontiguousarray(near[rows, columns])
    return replace(block, start_m=start_m, end_m=end_m, low_y_m=low_y_m), part, kept
