"""A block's events as rays: of any motion as an array, of a straight path made when needed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_emvs.evidence import CELL_PX, RayField
from roller_emvs.evidence.field import sample_median
from roller_emvs.rays import F32

from . import _ray_kernels as kernels
from ._event_kernels import PAGE
from .blocks import MARGIN_M, Block
from .strip import Strip

I32 = npt.NDArray[np.int32]


def ray_field(strip: Strip, block: Block) -> RayField:
    """A block's events as rays, for motion that parts don't fit; grid as `part_field`'s.

    There a row is a fan through the camera's mean path, not level: rows of the sensor that came
    apart from plane to plane would mix with their neighbours. So a slope across is what lies
    between a ray's and the fan's.
    """
    pixel = strip.pixel_m
    size = CELL_PX * pixel
    rows = max(int(np.ceil((block.high_y_m - block.low_y_m) / size)), 2) * CELL_PX
    parts = [strip.events(block, polarity) for polarity in range(2)]
    rays = np.concatenate(
        [
            np.column_stack([e.x_m + MARGIN_M, e.y_m - block.low_y_m, e.slope, across - fan])
            for e in parts
            for across in [strip.across(e, block.number * strip.settings.block_m)]
            for fan in [strip.fan(block, e.y_m.astype(np.float64))]
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


class StripRays:
    """Events that reach a block's rows as rays of a straight path, in pixels of its grid.

    A `RaySource`; they have no slope across.

    Parameters
    ----------
    strip : Strip
        Holds the events.
    block : Block
        Rows.
    polarity : int
        0 for OFF, 1 for ON events.
    reach_m : float
        Events further beside the block are left out, m.
    every : int
        Every n-th event of a page of the store.

    Raises
    ------
    ValueError
        If a page is no multiple of `every`.
    """

    def __init__(
        self, strip: Strip, block: Block, polarity: int, reach_m: float, every: int = 1
    ) -> None:
        if PAGE % every:
            raise ValueError(f"every {every}-th event: {PAGE} to a page are no multiple of it")
        begins, pages, counts = strip.chains(block, polarity, reach_m)
        chains = begins - MARGIN_M, pages, counts
        store = strip.store
        self._events = (
            store.records, store.link, chains, strip.scales(block), every, strip.ends
        )  # fmt: skip
        self._most = int((-(-counts // every)).sum())
        self._some = np.empty((PAGE, 4), np.float32)

    def ground(self, surface: F32) -> tuple[I32, I32]:
        """See `RaySource`."""
        pixel, counted = np.empty(self._most, np.int32), np.zeros(surface.size + 1, np.int32)
        start = sample_median(surface)
        flat = np.append(surface, np.float32(np.nan))
        count = kernels._ground_pages(
            *self._events, flat, np.float32(0) if start is None else start, surface.shape[1],
            self._some, pixel, counted,
        )  # fmt: skip
        return pixel[:count], counted

    def by_pixel(self, pixel: I32, place: I32, out: F32) -> None:
        """See `RaySource`."""
        kernels._pages_by_pixel(*self._events, self._some, pixel, place, out)

    def array(self) -> F32:
        """See `RaySource`."""
        out = np.empty((self._most, 4), np.float32)
        return out[: kernels._rays(*self._events, out)]
