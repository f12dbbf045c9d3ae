"""Leaving out what no event reaches of a block, before anything is looked for.

Around what lies on a bare plate most of a block is empty, of one that is joined of three lengths
above all. Sums over neighbourhoods, planes through them and images take as long there as elsewhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roller_emvs.evidence import CELL_PX

from ._part_kernels import TILE_CELLS
from .part_field import PartField
from .strip import MARGIN_M, Block

#: Cells around those that events reach in which they may have a depth, as evidence is summed over
#: so many, and around these the cells that tell on their surface.
_AROUND_CELLS = 5 + 8


def narrowed(block: Block, field: PartField, pixel_m: float) -> tuple[Block, PartField]:
    """Block and field of what events reach; the same where that is most of them.

    Parameters
    ----------
    block : Block
        Rows that are done.
    field : PartField
        Its votes.
    pixel_m : float
        Size of the grid's pixels.
    """
    tiles = np.logical_or(*field.reached)
    # Where nothing is reached anything does, if it is small.
    tiles[0, 0] |= not tiles.any()
    # A column's evidence is looked for along the middle of the rays that it was seen by.
    moved = int(np.ceil(np.abs(field.middles).max() * field.most_offset / CELL_PX)) + 1
    cells = np.repeat(tiles, TILE_CELLS, axis=1)[:, : field.cells[1]]
    cut = field.cut_around(cells, _AROUND_CELLS + moved)
    if cut is None:
        return block, field
    part, (rows, columns) = cut
    size = CELL_PX * pixel_m
    start_m = block.start_m + columns.start * size
    low_y_m = block.low_y_m + rows.start * size
    end_m = block.end_m
    if columns.stop < field.cells[1]:
        end_m = block.start_m + columns.stop * size - 2 * MARGIN_M
    return replace(block, start_m=start_m, end_m=end_m, low_y_m=low_y_m), part
