"""A block's events as images by part of the aperture: one vote an event.

A ray's slope along the strip is that of its image column, so a part of the aperture is a group of
columns. An event votes once, into its part's image at its place on the middle plane; a plane of
votes is the sum of the parts, each moved by whole bins (slant stacking, a discrete Radon transform
along rows). Votes are kept by row of cells, and images made of one row of cells at a time: of all
rows they would be tens of megabytes, of which events touch a hundredth.

Rows are those of the middle plane: as the camera goes straight along x, all rays of a row fan out
alike and stay in one row over all planes; only where that row lies across the strip depends on the
plane. `fits` says how straight is straight enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.evidence import CELL_PX, EvidenceField, plane_offsets
from roller_emvs.evidence.field import Box, Mask, box_around, shape_of
from roller_emvs.rays import F32, I64
from roller_emvs.threads import share

from . import _part_kernels as kernels
from . import _sharpness_kernels as sharpness
from ._event_kernels import PAGE
from ._part_kernels import BINS_PX, CELL_BINS, ROW_PX, TILE_BINS, TILE_CELLS
from .blocks import MARGIN_M, Block
from .strip import Strip

U32 = npt.NDArray[np.uint32]

#: Parts of the image along the roll that a coarse depth is the sum of: a row crosses all of it,
#: and over such an aperture relief that repeats has side lobes.
COARSE_PARTS = 4
#: Parallax within a part over the depth range: at its ends a ray is off by a quarter of it, px.
_PART_PX = 2.4
#: Parts and bins of a polarity at most, beyond which images would cost more than they save.
_MOST_PARTS, _MOST_BINS = 64, 64_000_000
#: Rays of a row may part by so much across the strip at the ends of the depth range, px.
_MOST_ACROSS_PX = 0.5
#: Tiles that fewer events can reach are left out: a peak takes more (`sweep._SPOTS`).
_LEAST_EVENTS = 16


@dataclass(frozen=True)
class PartField(EvidenceField):
    """Votes of a block's events by part of the aperture, for each polarity."""

    #: By polarity, by row of cells; see `_part_kernels`.
    votes: tuple[U32, U32]
    #: Where each row of cells begins in them, and the last ends. Shape (2, rows of cells + 1).
    starts: I64
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
    #: Events reach no further beside the block on any plane.
    reach_m: float

    def cut_around(self, cells: Mask, reach: int) -> tuple[PartField, Box] | None:
        """See `EvidenceField`."""
        box = box_around(cells, reach, TILE_CELLS)
        if box is None:
            return None
        (rows, columns), (_, parts, bins) = box, self.bins
        shape, starts = shape_of(box), self.starts[:, rows.start : rows.stop + 1]
        tiles = slice(columns.start // TILE_CELLS, -(-columns.stop // TILE_CELLS))
        part = replace(
            self, shape=shape, slopes=self.slopes[:, columns], starts=starts,
            bins=(shape[0], parts, bins), left_bin=self.left_bin + columns.start * CELL_BINS,
            reached=self.reached[:, rows, tiles], most_spread=self.aperture, is_part=True,
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
        _, parts, bins = self.bins
        buffers = np.empty(bins, np.uint8), np.empty(bins, np.uint16)
        kernels._gather_slopes(
            self.votes[polarity], self.starts[polarity], _base(parts, 0, bins), self.bins,
            self.left_bin, surface, np.float32(self.most_offset), self._per_offset,
            self.part_slopes.astype(np.float32), np.float32(width**2 / 12),
            np.zeros(parts * bins, np.uint8), buffers, sums,
        )  # fmt: skip
        return sums

    def support(self, offset: F32, polarity: int) -> F32:
        """See `EvidenceField`."""
        found, columns = np.zeros(self.shape, np.float32), self.shape[1]
        _, parts, bins = self.bins
        buffers = (
            np.empty(bins, np.uint8), np.empty(columns, np.float32),
            *np.empty((3, columns), np.int32),
        )  # fmt: skip
        kernels._gather(
            self.votes[polarity], self.starts[polarity], _base(parts, parts * bins, bins),
            self.bins, self.left_bin, offset, np.float32(self.most_offset), self.reached[polarity],
            self._per_offset, np.zeros(CELL_PX * parts * bins, np.uint8), buffers, found,
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
            rows and of bins twice as wide: neighbourhoods are.
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
        groups, looks, halve = (COARSE_PARTS, 1, 1) if coarsely else (1, CELL_PX // ROW_PX, 0)
        shifts = whole_shifts(self.part_slopes, at, BINS_PX >> halve)
        rows, parts, bins = self.bins
        bins, left = bins >> halve, self.left_bin >> halve
        pair = (parts + 1) * bins
        base = _base(parts, pair, bins, ROW_PX)
        # Rows that aren't looked at count behind the rest.
        base = np.where(base < looks * pair, base, looks * pair)

        def run(begin: int) -> None:
            pairs = np.zeros(looks * pair + bins, np.uint8)
            eight = np.zeros(bins + TILE_BINS, np.uint8)
            total, sums = np.zeros((2, bins + TILE_BINS), np.uint16)
            line = np.zeros(bins, np.float32)
            sharpness._measure(
                self.votes[polarity], self.starts[polarity], base, (rows, parts, bins), left,
                halve, begin, self.cells[0], threads, groups, looks, pairs, shifts, tiles,
                (eight, total, sums), line, found,
            )  # fmt: skip

        share(threads, threads, run)
        return found


@lru_cache(maxsize=32)
def _base(parts: int, of_row: int, of_part: int, rows: int = 1) -> I64:
    """Where the image of each row of a cell and part begins, so many `rows` in one."""
    row, part = np.divmod(np.arange(CELL_PX * parts), parts)
    return np.asarray(row // rows * of_row + part * of_part, np.int64)


def whole_shifts(middles: F64, at: F64, bins_px: int = BINS_PX) -> I64:
    """Bins by which each part moves to each plane, int64, shape (planes, parts).

    What rounding leaves of a part is given to the next: rounded one by one, the parts would lie on
    another plane than asked for, by some micrometres.
    """
    wanted = np.outer(at, middles) * bins_px
    shifts = np.rint(np.cumsum(wanted, axis=1)).astype(np.int64)
    shifts[:, 1:] -= shifts[:, :-1].copy()
    return shifts


def fits(strip: Strip, block: Block) -> bool:
    """Whether the camera went straight enough, and parallax is small enough, for parts."""
    centres = strip.centres(block)
    off = np.abs(centres - centres.mean(axis=0)).max(axis=0)
    wide = max(
        abs(block.low_y_m - centres[:, 1].mean()), abs(block.high_y_m - centres[:, 1].mean())
    )
    across = (off[1] + off[2] * wide / strip.middle_m) / strip.middle_m
    least, most = strip.slopes
    parts = (most - least) * 2 * strip.half_m / strip.pixel_m / _PART_PX
    rows = (block.high_y_m - block.low_y_m) / strip.pixel_m
    length = strip.settings.block_m + 2 * (MARGIN_M + strip.half_m * max(-least, most))
    return bool(
        across * strip.half_m <= _MOST_ACROSS_PX * strip.pixel_m
        and parts <= _MOST_PARTS
        and parts * rows * length / strip.pixel_m * BINS_PX <= _MOST_BINS
    )


def part_field(strip: Strip, block: Block, per_px: float, threads: int) -> PartField:
    """Take the votes of a block's events, and of those that reach it from beside.

    The grid begins `MARGIN_M` before the block, in its first pixel's middle, and at its least y.
    `per_px` are planes by pixel of parallax.
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
    # An odd number, so that parts don't fall onto the same lines of the caches.
    tiles = (count + 2 * apron) | 1
    shape = (rows, parts, tiles * TILE_BINS)
    seen = np.zeros((2, rows // CELL_PX * tiles + 1), np.int32)
    field = PartField(
        (rows, columns), slopes, pixel, 1.0, strip.focal_px, strip.speed_m_s / pixel,
        1.0, (np.empty(0, np.uint32),) * 2, np.zeros((2, rows // CELL_PX + 1), np.int64), shape,
        apron * TILE_BINS, furthest, part_slopes, np.zeros((2, rows // CELL_PX, count), np.bool_),
        MARGIN_M + size + max(-least, most) * furthest, camera_m_s=strip.speed_of(block),
    )  # fmt: skip
    field = _take_votes(strip, block, field, seen, threads)
    reach = int(np.ceil(strip.half_m * bins_per_m / TILE_BINS))
    sums = np.zeros((2, rows // CELL_PX, tiles + 1), np.int32)
    np.cumsum(seen[:, :-1].reshape(2, -1, tiles), axis=2, out=sums[..., 1:])
    begin, end = apron - reach, apron + reach + 1
    np.greater_equal(
        sums[..., end : end + count] - sums[..., begin : begin + count], _LEAST_EVENTS,
        out=field.reached,
    )  # fmt: skip
    return field


def _take_votes(
    strip: Strip, block: Block, field: PartField, seen: npt.NDArray[np.int32], threads: int
) -> PartField:
    """A field with the votes of the events that reach a block; `seen` counts them by tile."""
    pixel, store = strip.pixel_m, strip.store
    width = float(field.part_slopes[1] - field.part_slopes[0]) * pixel
    least = float(field.part_slopes[0]) * pixel - 0.5 * width
    left = field.left_bin + (MARGIN_M / pixel + 0.5) * BINS_PX
    rows = field.cells[0]
    found: list[U32] = [np.empty(0, np.uint32)] * 2
    starts = np.zeros((2, rows + 1), np.int64)

    def run(polarity: int) -> None:
        chains, scales = strip.chains(block, polarity, field.reach_m), strip.scales(block)
        total = int(chains[2].sum())
        votes, lines = np.empty(total, np.uint32), np.empty(total, np.uint16)
        kernels._locate(
            store.records, store.link, chains, scales, least, width, strip.ends, field.bins, left,
            np.empty(PAGE, np.int32), votes, lines, seen[polarity],
        )  # fmt: skip
        by_row = seen[polarity, :-1].reshape(rows, -1).sum(axis=1)
        np.cumsum(by_row, out=starts[polarity, 1:])
        found[polarity] = np.empty(total, np.uint32)
        kernels._sort(votes, lines, starts[polarity].copy(), found[polarity])

    share(threads, 2, run)
    return replace(field, votes=(found[0], found[1]), starts=starts)
