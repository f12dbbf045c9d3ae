"""Images of the parts of an aperture, of which planes are sums: one vote an event.

Where a window's motion moves the image along its rows, the events of one part of the aperture,
all of about one slope, make one image on the middle plane, and a plane is the sum of the parts'
images, each moved by slope · offset: slant stacking, a discrete Radon transform along rows. What
it costs doesn't depend on how many events there are.

Images move by whole bins. Their rounding would move a plane's offset by a few hundredths of the
step between planes; the offset that a plane has in effect is that of the line through the moves
of the parts that saw a column. Bins begin elsewhere in each part, so that no plane has all its
parts rounded alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray
from roller_core.transforms import F64
from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _band_kernels as band_kernels
from . import _part_kernels as kernels
from ._band_kernels import BAND_ROWS, BINS, KEYS, ROW_BITS
from ._kernels import CELL_PX, ROW_PX
from ._part_kernels import EDGE_PX
from .evidence_settings import EvidenceSettings
from .field import EvidenceField
from .focus_measure import plane_offsets
from .sweep import Depths, sharpest

U32 = npt.NDArray[np.uint32]
I64 = npt.NDArray[np.int64]

#: Of an irrational number: bins of parts begin in no steady order.
_STAGGER = 0.381966


@dataclass(frozen=True)
class Parts:
    """Parts of the aperture that a window was seen through."""

    #: Mean slope of each, px by unit of offset; increasing. Shape (parts,).
    slopes: F64
    #: Range of slopes of each.
    width: float
    #: The part that each packet belongs to. Shape (packets,).
    of_packet: I64

    @property
    def phase(self) -> F32:
        """Where each part's bins begin, in bins."""
        number = np.arange(len(self.slopes), dtype=np.float64)
        return (0.5 * _STAGGER * number**2 % 1.0).astype(np.float32)


@dataclass(frozen=True)
class PartImages(EvidenceField):
    """Events on the middle plane by part of the aperture; they become images band by band."""

    #: The parts.
    parts: Parts
    #: Columns before the grid at which images begin, and after it at which they end, at least
    #: `EDGE_PX`: events may come into it from there.
    margin: int
    #: Columns of its image that each part saw, first and beyond the last. Shape (parts, 2).
    spans: I64
    #: Events by polarity, OFF first, and band of rows; see `_band_kernels`. Shape (n,).
    events: U32
    #: Where the bands of either polarity begin and end. Shape (2, bands + 1).
    starts: I64

    def focus_measure(self, at: F64, polarity: int, threads: int = 1) -> F32:
        """Sharpness of the votes by plane and cell, not yet summed over neighbourhoods.

        Parameters
        ----------
        at : ndarray of float64, shape (planes,)
            Offsets of the planes.
        polarity : int
            0 for OFF, 1 for ON events.
        threads : int
            Threads that share the bands.

        Returns
        -------
        ndarray of float32, shape (planes, rows, columns)
            Sums of squared slopes along x; 0 where hardly an event comes on any plane.
        """
        width, reach, lines, shifts = self.shape[1] + 2 * EDGE_PX, *self._moves(at)
        measure = np.zeros((len(at), *self.cells), np.float32)
        rows, wide = BAND_ROWS // ROW_PX, width + 2 * reach

        def run(first: int) -> None:
            images = np.empty(lines.shape[2] * BINS * rows * wide + reach, np.uint8)
            sums = np.empty(BINS * rows * wide, np.uint16)
            columns = np.empty(self._columns + 1, np.int64)
            votes, line = np.zeros((rows, width), np.float32), np.zeros(width, np.float32)
            kernels._measure_bands(
                self.events, self.starts[polarity], lines, shifts, reach, self.margin, first,
                threads, images, sums, votes, line, columns, measure,
            )  # fmt: skip

        share(threads, threads, run)
        return measure

    def planes_in_effect(self, at: F64) -> F64:
        """See `EvidenceField`: of the line through the moves of the parts that saw a column."""
        slopes, (low, high) = self.parts.slopes, self.slopes
        moved = (self._shifts(at) + self.parts.phase) / BINS - np.outer(at, slopes)
        half = 0.5 * self.parts.width
        inside = np.minimum(slopes[:, None] + half, high) - np.maximum(slopes[:, None] - half, low)
        weight = np.clip(inside / self.parts.width, 0.0, 1.0)
        total = np.maximum(weight.sum(axis=0), 1e-9)
        beside = slopes[:, None] - (weight * slopes[:, None]).sum(axis=0) / total
        square = (weight * beside**2).sum(axis=0)
        slant = moved @ (weight * beside) / np.maximum(square, self.parts.width**2)
        return np.asarray(at[:, None] + slant)

    def slope_sums(self, offset: F32, polarity: int) -> F32:
        """See `EvidenceField`."""
        parts, slopes = self.parts, self.parts.slopes
        known = np.abs(offset[np.isfinite(offset)])
        sums = np.zeros((*self.cells, 3), np.float32)
        if not len(known):
            return sums
        pad = int(np.abs(slopes).max() * known.max()) + CELL_PX + 1
        lines = np.empty(
            (BAND_ROWS // CELL_PX, len(slopes), self._columns + 2 * pad + CELL_PX), np.uint16
        )
        base = self._base(lines.shape[2], lines.shape[1] * lines.shape[2], CELL_PX) + pad
        square = (slopes**2 + parts.width**2 / 12).astype(np.float32)
        kernels._slope_sums(
            self.events, self.starts[polarity], base, offset, slopes.astype(np.float32), square,
            parts.phase, pad + self.margin, lines, sums,
        )  # fmt: skip
        return sums

    def support(self, offset: F32, polarity: int) -> F32:
        """See `EvidenceField`."""
        found, width, parts = np.zeros(self.shape, np.float32), self.shape[1], self.parts
        images = np.empty((len(parts.slopes), BAND_ROWS, BINS * self._columns + 4), np.uint8)
        buffers = (
            *np.empty((2, width), np.float32), np.empty((4, width), np.int32),
            np.empty(width, np.int32), np.empty(width + 1, np.int32), np.empty(KEYS, np.bool_),
        )  # fmt: skip
        kernels._support(
            self.events, self.starts[polarity],
            self._base(BAND_ROWS * images.shape[2], images.shape[2], 1), self.spans, offset,
            parts.slopes.astype(np.float32), parts.phase, self.margin, buffers, images, found,
        )  # fmt: skip
        return found

    @property
    def _columns(self) -> int:
        """Columns of images, with their margins."""
        return self.shape[1] + 2 * self.margin

    def _base(self, of_part: int, of_row: int, rows: int) -> I64:
        """Where the image of a part and row of a band begins, so many `rows` in one."""
        part, row = np.divmod(np.arange(KEYS), 1 << ROW_BITS)
        return np.asarray(part * of_part + row // rows * of_row, np.int64)

    def _moves(self, at: F64) -> tuple[int, I64, I64]:
        """How images are moved for each plane.

        Returns
        -------
        reach : int
            Columns by which they move at most, and one more.
        lines : ndarray of int64, shape (planes, BINS, parts or up to three more)
            The image, by part and phase, that adds to a phase of the votes.
        shifts : ndarray of int64, the same shape
            The column of it that adds to the first one.
        """
        shifts = self._shifts(at)
        planes, count = shifts.shape
        moved = np.zeros((planes, BINS, -(-count // 4) * 4), np.int64)
        moved[:, :, :count] = np.arange(BINS)[:, None] - shifts[:, None, :]
        column, phase = np.divmod(moved, BINS)
        reach = int(np.abs(shifts).max()) // BINS + 1
        return reach, np.arange(moved.shape[2]) * BINS + phase, column

    def _shifts(self, at: F64) -> I64:
        """Bins by which each part's image is moved for each plane, shape (planes, parts)."""
        return np.rint(BINS * np.outer(at, self.parts.slopes) - self.parts.phase).astype(np.int64)


def sort_events(
    events: EventArray,
    table: F32,
    starts: I64,
    to_middle: F64,
    parts: Parts,
    shape: tuple[int, int],
    margin: int,
    threads: int = 1,
) -> tuple[U32, I64, I64]:
    """Events on the middle plane, by polarity and band of rows.

    Parameters
    ----------
    events : EventArray
        In order of time.
    table : ndarray of float32, shape (height, width, 2)
        Ideal pixel of every pixel; NaN where events don't count.
    starts : ndarray of int64, shape (packets + 1,)
        Where packets begin; the last entry is n.
    to_middle : ndarray of float64, shape (packets, 3, 3)
        Homography from each packet's pixels to the grid's, on the plane of offset 0.
    parts : Parts
        The parts.
    shape : tuple of int
        Rows and columns of the grid.
    margin : int
        Columns before and after the grid.
    threads : int
        Threads that share the packets; the result doesn't depend on them.

    Returns
    -------
    events : ndarray of uint32, shape (n,)
    starts : ndarray of int64, shape (2, bands + 1)
    spans : ndarray of int64, shape (parts, 2)
        See `PartImages`.
    """
    packets, bands = len(starts) - 1, -(-shape[0] // BAND_ROWS)
    edges = [packets * k // threads for k in range(threads + 1)]
    counts = np.zeros((threads, 2 * bands + 1), np.int64)
    placed, out = np.empty((2, len(events)), np.uint32)
    mapping, phase = to_middle.astype(np.float32), parts.phase

    def place(k: int) -> None:
        buffers = (
            *np.empty((2, band_kernels.CHUNK), np.float32),
            np.empty(band_kernels.CHUNK, np.int32),
        )
        band_kernels._place(
            events.x, events.y, events.p, table, starts, (edges[k], edges[k + 1]),
            parts.of_packet, mapping, phase, shape, margin, buffers, placed, counts[k],
        )  # fmt: skip

    share(threads, threads, place)
    ends = np.append(0, np.cumsum(counts.sum(axis=0)))
    # A bucket's events are those of the first packets, in their order, then those of the next.
    places = ends[:-1] + np.cumsum(counts, axis=0) - counts

    def sort(k: int) -> None:
        band_kernels._sort(placed, starts[edges[k]], starts[edges[k + 1]], places[k], out)

    share(threads, threads, sort)
    found = np.stack([ends[: bands + 1], ends[bands : 2 * bands + 1]])
    return out, found, _spans(table, to_middle, parts, shape[1], margin)


def _spans(table: F32, to_middle: F64, parts: Parts, width: int, margin: int) -> I64:
    """Columns that parts saw: those between the corners of the image."""
    border = np.concatenate([table[[0, -1]].reshape(-1, 2), table[:, [0, -1]].reshape(-1, 2)])
    low, high = np.nanmin(border, axis=0), np.nanmax(border, axis=0)
    corners = np.array([[a, b, 1.0] for a in (low[0], high[0]) for b in (low[1], high[1])])
    forward = np.maximum(to_middle[:, 2] @ corners.T, 1e-6)
    column = to_middle[:, 0] @ corners.T / forward + 0.5 + margin
    spans = np.empty((len(parts.slopes), 2))
    spans[:] = width + 2 * margin, 0.0
    np.minimum.at(spans[:, 0], parts.of_packet, column.min(axis=1))
    np.maximum.at(spans[:, 1], parts.of_packet, column.max(axis=1) + 2)
    return np.clip(spans, 0, width + 2 * margin + 1).astype(np.int64)


def find_depths_of_parts(
    field: PartImages, low: float, high: float, settings: EvidenceSettings, threads: int = 1
) -> list[Depths]:
    """Depth on the grid's cells of OFF and of ON events, between two offsets; see `find_depths`."""
    at = plane_offsets(low, high, field.aperture * (high - low), settings.planes_per_px)
    first, last = np.zeros(field.cells, np.int32), np.full(field.cells, len(at) - 1, np.int32)
    found: list[Depths | None] = [None, None]

    def look(k: int) -> None:
        measure = field.focus_measure(at, k, max(threads // 2, 1))
        found[k] = sharpest(field, measure, at, first, last, k, settings)

    share(threads, 2, look)
    return [f for f in found if f is not None]
