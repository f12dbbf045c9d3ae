"""Pieces of an inspected surface: as they come, and put together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np

from .findings.finding import Finding
from .height_map.coverage import Coverage
from .height_map.height_map import F32, OUTSIDE, HeightMap
from .height_map.join import coarser, join_size, join_with
from .height_map.shares import coarser_shares, joined_shares, shares_of
from .references.reference import Alignment

_Grid = TypeVar("_Grid", bound=np.ndarray)


@dataclass(frozen=True)
class Piece:
    """A part of the surface that was inspected."""

    #: Its map.
    height_map: HeightMap
    #: From the reference; NaN where there is none. Shape (ny, nx).
    deviation_m: F32
    #: How much of each cell was not measured, continued and measured on the finer map that this is
    #: made of; None: what its state says. Shape (4, ny, nx).
    shares: F32 | None = None


@dataclass(frozen=True)
class Found:
    """What an inspection found."""

    #: The whole; of a scan that is too long for memory a coarser one. None without any point.
    height_map: HeightMap | None
    #: On the same grid. Shape (ny, nx).
    deviation_m: F32 | None
    #: All final, in the order of the scan.
    findings: tuple[Finding, ...]
    #: Of the reference (of the worst residual where the scan was given in pieces); None where it
    #: couldn't be laid on the scan.
    alignment: Alignment | None
    #: Of what was scanned.
    coverage: Coverage
    #: Why parts could not be compared; empty if all was.
    faults: tuple[str, ...]
    #: The strips that `SurfaceInspector.add` hadn't given yet.
    last: tuple[Piece, ...] = ()
    #: As of a `Piece`.
    shares: F32 | None = None
    #: Points that were left out: nowhere, or further from the others than any of a part.
    left_out: int = 0


class Whole:
    """All pieces as one, on a grid as coarse as it takes.

    Parameters
    ----------
    most_cells : int
        Cells at most.

    Attributes
    ----------
    piece : Piece or None
        So far.
    """

    def __init__(self, most_cells: int) -> None:
        self.piece: Piece | None = None
        self._most_cells = most_cells

    def add(self, piece: Piece) -> None:
        """Take the next piece."""
        pieces = [piece] if self.piece is None else [self.piece, piece]
        step = max(p.height_map.step_m for p in pieces)
        maps, factors = [], [1]
        while True:
            factors = [round(step / p.height_map.step_m) for p in pieces]
            maps = [
                coarser(p.height_map, p.deviation_m, factor)
                for p, factor in zip(pieces, factors, strict=True)
            ]
            if join_size([m for m, _ in maps]) <= self._most_cells:
                break
            step *= 2
        whole, deviation_m = join_with([m for m, _ in maps], [d for _, d in maps])
        shares = None
        if max(factors) > 1 or any(p.shares is not None for p in pieces):
            # A coarse state would count for all of its cell, the more so the longer the scan.
            own = [
                coarser_shares(p.height_map, _shares(p), factor)
                for p, factor in zip(pieces, factors, strict=True)
            ]
            shares = joined_shares(whole, [m for m, _ in maps], own)
        self.piece = Piece(whole, deviation_m, shares)


def _shares(piece: Piece) -> F32:
    """Of a piece that is fine still those of its states."""
    if piece.shares is not None:
        return piece.shares
    return shares_of(piece.height_map, piece.deviation_m)


def within(pieces: list[Piece], whole: HeightMap) -> list[Piece]:
    """What of pieces lies where a map isn't outside of what was scanned."""
    x = whole.x_m[(whole.state != OUTSIDE).any(axis=0)]
    out: list[Piece] = []
    if not len(x):
        return out
    for piece in pieces:
        ends = x[0] - whole.step_m / 2, x[-1] + whole.step_m / 2
        first, end = np.searchsorted(piece.height_map.x_m, ends)
        if first < end:
            columns = slice(int(first), int(end))
            part = piece.height_map.cropped(columns, slice(None))
            out.append(Piece(part, piece.deviation_m[:, columns]))
    return out


def part_of(values: _Grid, window: HeightMap, part: HeightMap) -> _Grid:
    """What a grid of a window holds for a part of it."""
    i = round(float(part.x_m[0] - window.x_m[0]) / window.step_m)
    j = round(float(part.y_m[0] - window.y_m[0]) / window.step_m)
    return cast("_Grid", values[j : j + part.shape[0], i : i + part.shape[1]])
