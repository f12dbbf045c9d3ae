"""A block's events as rays, for motion that parts of the aperture don't fit."""

from __future__ import annotations

import numpy as np

from roller_emvs.evidence import CELL_PX, RayField

from .blocks import MARGIN_M, Block
from .strip import Strip


def ray_field(strip: Strip, block: Block) -> RayField:
    """A block's events as rays, for motion that parts don't fit; grid as `part_field`'s."""
    pixel = strip.pixel_m
    size = CELL_PX * pixel
    rows = max(int(np.ceil((block.high_y_m - block.low_y_m) / size)), 2) * CELL_PX
    parts = [strip.events(block, polarity) for polarity in range(2)]
    rays = np.concatenate(
        [
            np.column_stack([e.x_m + MARGIN_M, e.y_m - block.low_y_m, e.slope, across])
            for e in parts
            for across in [strip.across(e, block.number * strip.settings.block_m)]
        ]
    )
    rays /= pixel
    bounds = np.cumsum([0, *(len(e) for e in parts)]).astype(np.int64)
    x = strip.cell_columns(block)
    slopes = np.stack(strip.slopes_seen(x)) / pixel
    speed = strip.speed_m_s / pixel
    return RayField(
        (rows, len(x) * CELL_PX),
        slopes,
        pixel,
        1.0,
        strip.focal_px,
        speed,
        1.0,
        rays.astype(np.float32),
        bounds,
        camera_m_s=strip.speed_of(block),
    )
