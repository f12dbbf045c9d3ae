"""A block's events as histograms by part of the aperture: one vote an event.

A ray's slope along the strip is that of its image column, so a part of the aperture is a group of
columns. An event votes once, into its part's histogram at its place on the middle plane; a plane
of votes is the sum of the parts, each moved by whole bins (slant stacking, a discrete Radon
transform along rows). Nothing is sorted, and what meets a surface is read where it lies.

Rows are those of the middle plane: as the camera goes straight along x, all rays of a row fan out
alike and stay in one row over all planes; only where that row lies across the strip depends on the
plane. `fits` says how straight is straight enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.evidence import (
    CELL_PX,
    Depths,
    EvidenceField,
    EvidenceSettings,
    coarse_planes,
    offset_of_parts,
    plane_offsets,
    planes_near,
    sharpest,
)
from roller_emvs.evidence.field import Box, Mask, box_around, shape_of
from roller_emvs.rays import F32, I64
from roller_emvs.threads import share

from . import _part_kernels as kernels
from ._event_kernels import PAGE
from ._part_kernels import BINS_PX, CELL_BINS, ROW_PX, TILE_BINS, TILE_CELLS
from .strip import MARGIN_M, Block, Strip

#: Parts of the image along the roll that a coarse depth is the sum of: a row crosses all of it,
#: and over such an aperture relief that repeats has side lobes.
COARSE_PARTS = 4
#: Parallax within a part over the depth range: at its ends a ray is off by a quarter of it, px.
_PART_PX = 2.4
#: Parts and bins of a polarity at most, beyond which histograms would cost more than they save.
_MOST_PARTS, _MOST_BINS = 64, 64_000_000
#: Rays of a row may part by so much across the strip at the ends of the depth range, px.
_MOST_ACROSS_PX = 0.5
#: Tiles that fewer events can reach are left out: a peak takes more (`sweep._SPOTS`).
_LEAST_EVENTS = 16
#: Cells by which what is searched around a cell is searched too, as evidence is summed over them.
_AROUND_CELLS = 3


@dataclass(frozen=True)
class PartField(EvidenceField):
    """Histograms of a block's events by part of the aperture, for each polarity."""

    #: By polarity; flat, of rows, parts and bins, with one entry more. Until `clear`.
    counts: tuple[npt.NDArray[np.uint8], ...]
    #: Rows, parts, bins.
    bins: tuple[int, int, int]
    #: Bin of the grid's first column.
    left_bin: int
    #: Planes may lie so far from the middle.
    most_offset: float
    #: Slopes of the parts' middles, px by unit of offset. Shape (parts,).
    part_slopes: F64
    #: Tiles that enough events of a polarity can reach. Shape (2, rows of cells, tiles of the
    #: grid).
    reached: Mask
    #: By polarity: where in `counts` its events count.
    places: list[npt.NDArray[np.int32]]
    #: Events reach no further beside the block on any plane.
    reach_m: float

    def cut_around(self, cells: Mask, reach: int) -> tuple[PartField, Box] | None:
        """See `EvidenceField`."""
        box = box_around(cells, reach, TILE_CELLS)
        if box is None:
            return None
        (rows, columns), (_, parts, bins) = box, self.bins
        line, shape = CELL_PX * parts * bins, shape_of(box)
        counts = tuple(own[rows.start * line : rows.stop * line + 1] for own in self.counts)
        tiles = slice(columns.start // TILE_CELLS, -(-columns.stop // TILE_CELLS))
        part = replace(
            self, shape=shape, slopes=self.slopes[:, columns], counts=counts,
            bins=(shape[0], parts, bins), left_bin=self.left_bin + columns.start * CELL_BINS,
            reached=self.reached[:, rows, tiles], most_spread=self.aperture,
        )  # fmt: skip
        return part, box

    @property
    def _per_offset(self) -> F32:
        return (BINS_PX * self.part_slopes).astype(np.float32)

    def slope_sums(self, offset: F32, polarity: int) -> F32:
        """See `EvidenceField`."""
        sums = np.zeros((*self.cells, 3), np.float32)
        reached = np.repeat(self.reached[polarity], TILE_CELLS, axis=1)[:, : self.cells[1]]
        surface = np.where(reached, offset, np.float32(np.nan))
        width = (self.part_slopes[-1] - self.part_slopes[0]) / (len(self.part_slopes) - 1)
        buffers = (*np.empty((2, self.bins[2]), np.uint8), np.empty(self.bins[2], np.uint16))
        kernels._gather_slopes(
            self.counts[polarity], self.bins, self.left_bin, surface, np.float32(self.most_offset),
            self._per_offset, self.part_slopes.astype(np.float32), np.float32(width**2 / 12),
            buffers, sums,
        )  # fmt: skip
        return sums

    def support(self, offset: F32, polarity: int) -> F32:
        """See `EvidenceField`."""
        found, columns = np.zeros(self.shape, np.float32), self.shape[1]
        buffers = (
            np.empty(self.bins[2], np.uint8), np.empty(columns, np.float32),
            *np.empty((3, columns), np.int32),
        )  # fmt: skip
        kernels._gather(
            self.counts[polarity], self.bins, self.left_bin, offset, np.float32(self.most_offset),
            self.reached[polarity], self._per_offset, buffers, found,
        )  # fmt: skip
        return found

    def measure(
        self, polarity: int, at: F64, coarsely: bool, tiles: npt.NDArray[np.int32], threads: int
    ) -> F32:
        """Sharpness of the votes by plane and cell, not yet summed over neighbourhoods.

        Parameters
        ----------
        polarity : int
            0 for OFF, 1 for ON events.
        at : ndarray of float64, shape (planes,)
            Offsets of the planes.
        coarsely : bool
            Add up the sharpness of `COARSE_PARTS` parts of the aperture, of every other pair of
            rows: neighbourhoods are wide.
        tiles : ndarray of int32, shape (rows of cells, tiles, 2)
            First and last plane on which each tile counts; last < first: none.
        threads : int
            Threads that share the rows.

        Returns
        -------
        ndarray of float32, shape (planes, rows, columns)
            Sums of squared slopes along x.
        """
        found = np.zeros((len(at), *self.cells), np.float32)
        shifts = whole_shifts(self.part_slopes, at)
        groups, looks = (COARSE_PARTS, 1) if coarsely else (1, CELL_PX // ROW_PX)
        _, parts, bins = self.bins

        def run(begin: int) -> None:
            pairs = np.zeros(looks * (parts + 1) * bins, np.uint8)
            total, sums = (np.zeros(bins + TILE_BINS, np.uint16) for _ in range(2))
            line = np.zeros(bins, np.float32)
            kernels._measure(
                self.counts[polarity], self.bins, self.left_bin, begin, self.cells[0], threads,
                groups, pairs, shifts, tiles, total, sums, line, found,
            )  # fmt: skip

        share(threads, threads, run, inner=True)
        return found


def whole_shifts(middles: F64, at: F64) -> I64:
    """Bins by which each part moves to each plane, int64, shape (planes, parts).

    What rounding leaves of a part is given to the next: rounded one by one, the parts would lie on
    another plane than asked for, by some micrometres.
    """
    wanted = np.outer(at, middles) * BINS_PX
    return np.diff(np.rint(np.cumsum(wanted, axis=1)), axis=1, prepend=0).astype(np.int64)


def fits(strip: Strip, block: Block) -> bool:
    """Whether the camera went straight enough, and the parallax is small enough, for histograms."""
    centres = strip.centres(block)
    off = np.abs(centres - centres.mean(axis=0)).max(axis=0)
    wide = max(
        abs(block.low_y_m - centres[:, 1].mean()), abs(block.high_y_m - centres[:, 1].mean())
    )
    across = (off[1] + off[2] * wide / strip.middle_m) / strip.middle_m
    least, most = strip.slopes
    parts = (most - least) * 2 * strip.half_m / strip.pixel_m / _PART_PX
    rows = (block.high_y_m - block.low_y_m) / strip.pixel_m
    length = block.end_m - block.start_m + 2 * (MARGIN_M + strip.half_m * max(-least, most))
    return bool(
        across * strip.half_m <= _MOST_ACROSS_PX * strip.pixel_m
        and parts <= _MOST_PARTS
        and parts * rows * length / strip.pixel_m * BINS_PX <= _MOST_BINS
    )


class PartBuffers:
    """Histograms' memory, kept from block to block; all zero unless a block is at work."""

    def __init__(self) -> None:
        self._kept = [np.zeros(0, np.uint8), np.zeros(0, np.uint8)]

    def take(self, size: int) -> tuple[npt.NDArray[np.uint8], ...]:
        """So many zeros for either polarity."""
        if len(self._kept[0]) < size:
            self._kept = [np.zeros(size, np.uint8) for _ in range(2)]
        return tuple(kept[:size] for kept in self._kept)


def part_field(
    strip: Strip, block: Block, buffers: PartBuffers, per_px: float, threads: int
) -> PartField:
    """Count a block's events, and those that reach it from beside, into histograms.

    The grid begins `MARGIN_M` before the block, in its first pixel's middle, and at its least y.
    `per_px` are planes by pixel of parallax. `clear` gives the memory back.
    """
    pixel = strip.pixel_m
    size = CELL_PX * pixel
    rows = max(int(np.ceil((block.high_y_m - block.low_y_m) / size)), 2) * CELL_PX
    x = strip.cell_columns(block)
    columns = len(x) * CELL_PX
    slopes = np.stack(strip.slopes_seen(x)) / pixel
    least, most = strip.slopes
    parallax = (most - least) * 2 * strip.half_m / pixel
    parts = 2 * COARSE_PARTS * max(int(np.ceil(parallax / _PART_PX / (2 * COARSE_PARTS))), 1)
    width = max(most - least, 1e-9) / parts
    part_slopes: F64 = (least + (np.arange(parts, dtype=np.float64) + 0.5) * width) / pixel
    # Coarse planes lie furthest, one of their steps beyond the range.
    seen_px = max((slopes[1] - slopes[0]).max(), 0.0) * 2 * strip.half_m / COARSE_PARTS
    furthest = float(plane_offsets(-strip.half_m, strip.half_m, seen_px, per_px)[-1])
    bins_per_m = float(np.abs(part_slopes).max()) * BINS_PX
    apron = int(np.ceil(furthest * bins_per_m / TILE_BINS)) + 1
    count = -(-columns // (CELL_PX * TILE_CELLS))
    # An odd number, so that rows don't fall onto the same lines of the caches.
    tiles = (count + 2 * apron) | 1
    shape = (rows, parts, tiles * TILE_BINS)
    seen = np.zeros((2, rows // CELL_PX * tiles + 1), np.int32)
    field = PartField(
        (rows, columns), slopes, pixel, 1.0, strip.focal_px, strip.speed_m_s / pixel,
        1.0, buffers.take(rows * parts * tiles * TILE_BINS + 1), shape, apron * TILE_BINS, furthest,
        part_slopes, np.zeros((2, rows // CELL_PX, count), np.bool_), [np.empty(0, np.int32)] * 2,
        MARGIN_M + size + max(-least, most) * furthest, camera_m_s=strip.speed_of(block),
    )  # fmt: skip
    _count(strip, block, field, seen, threads)
    reach = int(np.ceil(strip.half_m * bins_per_m / TILE_BINS))
    sums = np.cumsum(np.pad(seen[:, :-1].reshape(2, -1, tiles), ((0, 0), (0, 0), (1, 0))), axis=2)
    begin, end = apron - reach, apron + reach + 1
    np.greater_equal(
        sums[..., end : end + count] - sums[..., begin : begin + count], _LEAST_EVENTS,
        out=field.reached,
    )  # fmt: skip
    return field


def clear(field: PartField, threads: int) -> None:
    """Make the memory of a field zero again: cheaper by its events than as a whole."""
    share(threads, 2, lambda k: kernels._forget(field.places[k], field.counts[k]))


def _count(
    strip: Strip, block: Block, field: PartField, seen: npt.NDArray[np.int32], threads: int
) -> None:
    """Count the events that reach a block."""
    pixel, store = strip.pixel_m, strip.store
    width = float(field.part_slopes[1] - field.part_slopes[0]) * pixel
    least = float(field.part_slopes[0]) * pixel - 0.5 * width
    left = field.left_bin + (MARGIN_M / pixel + 0.5) * BINS_PX

    def run(polarity: int) -> None:
        chains, n = list(strip.chains(block, polarity, field.reach_m)), 0
        tile, place = (np.empty(size, np.int32) for size in (PAGE, sum(c for *_, c in chains)))
        field.places[polarity] = place
        for start, page, count in chains:
            kernels._count(
                store.records, store.link, page, count, -start, pixel, block.low_y_m, least, width,
                field.bins, left, tile, place[n : n + count], field.counts[polarity],
                seen[polarity],
            )  # fmt: skip
            n += count

    share(threads, 2, run)


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
