"""A block at hand: its rays, where its pixels lie, and what it tells of its pass."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.evidence import EvidenceField, Relief
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.lines.patch_ends import PatchEnds
from roller_emvs.lines.path_error import PathError
from roller_emvs.lines.ray_source import RaySource
from roller_emvs.rays import F32, I64

from .blocks import MARGIN_M, Block
from .strip import Strip

#: Under a printed texture every fourth event is enough for the path.
_PATH_EVERY = 4

#: Rows, columns and offsets of lines.
Places = tuple[I64, F64, F64]


@dataclass(frozen=True)
class BlockWork:
    """A block at hand, and where its pixels lie."""

    strip: Strip
    block: Block
    field: EvidenceField
    #: Rays of a polarity, every n-th of its events.
    rays: Callable[[int, int], RaySource]

    @property
    def columns(self) -> tuple[int, int]:
        """First pixel of the block along the roll, and the one after its last."""
        pixel, length_m = self.strip.pixel_m, self.block.end_m - self.block.start_m
        return round(MARGIN_M / pixel), round((MARGIN_M + length_m) / pixel)

    def along(self, column: npt.NDArray[Any]) -> F64:
        """Where columns lie along the strip, metres."""
        x = column * self.strip.pixel_m + self.block.start_m - MARGIN_M
        return np.asarray(x, np.float64)

    def across(self, row: npt.NDArray[Any], offset: F64) -> F64:
        """Where rows, which fan out, lie across the strip at some offsets, metres."""
        y = row * self.strip.pixel_m + self.block.low_y_m
        return np.asarray(y + self.strip.fan(self.block, y) * offset, np.float64)

    def in_base(self, points: LinePoints) -> tuple[F64, F64]:
        """Where points lie in base, shape (n, 3), metres, and the strip's axes there."""
        x, y = self.along(points.column), self.across(points.row, points.offset)
        z = points.offset + self.strip.middle_m
        return self.strip.to_base(np.stack([x, y, z], axis=1)), self.strip.rotation


def find_ends(
    ends: PatchEnds, work: BlockWork, found: Relief, lines: LinePoints, every: int
) -> bool:
    """See what a textured block tells of the ends of the contact patch; whether they moved."""
    for polarity, surface, places in _by_polarity(found, lines):
        events = work.rays(polarity, every).array()
        seen_at = events[:, 2].astype(np.float64) * work.field.ray_slope_scale
        ends.look(events, seen_at, surface, *places)
    return ends.find()


def learn_path(path: PathError, work: BlockWork, found: Relief, lines: LinePoints) -> None:
    """See what a textured block tells of the errors of the path."""
    block = work.block
    path.begin(block.start_m, block.end_m)
    for polarity, surface, places in _by_polarity(found, lines):
        events = work.rays(polarity, _PATH_EVERY).array()
        columns_m = block.start_m - MARGIN_M, work.strip.pixel_m
        path.look(events, work.field.ray_slope_scale, surface, places, columns_m)
    path.learn()


def _by_polarity(found: Relief, lines: LinePoints) -> Iterator[tuple[int, F32, Places]]:
    """Polarity, its surface, and rows, columns and offsets of its lines."""
    for polarity, surface in enumerate(found.surfaces):
        own = lines.polarity == polarity
        places = lines.row[own].astype(np.int64), lines.column[own], lines.offset[own]
        yield polarity, surface, places
