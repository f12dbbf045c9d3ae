"""What the reader gives: cells."""

from __future__ import annotations

from dataclasses import dataclass

from . import table
from .warp import F64


@dataclass(frozen=True)
class Cell:
    """One Braille cell read from the surface.

    Attributes
    ----------
    stamp_ns : int
        Time of the newest event seen over the cell, ROS time, ns.
    line, column : int
        Where it stands in the text, from 0.
    mask : int
        Raised dots as far as seen: dot 1 is bit 0 … dot 6 is bit 5.
    character : str
        What it stands for, given the cells before it; empty for a sign (number, capital, letter)
        and for a cell that is not readable.
    readable : bool
        Whether dots and character are certain.
    position : ndarray, shape (3,)
        Its middle in base, metres.
    confidence : float
        How sure the reading is, 0 to 1: that of the least certain dot.
    dot_confidence : tuple of float, length 6
        How sure each dot is (raised or not).
    dot_positions : ndarray, shape (6, 3)
        Where its six dots are, raised or not, in base, metres.
    """

    stamp_ns: int
    line: int
    column: int
    mask: int
    character: str
    readable: bool
    position: F64
    confidence: float
    dot_confidence: tuple[float, ...]
    dot_positions: F64

    @property
    def pattern(self) -> str:
        """The dots as one Unicode Braille pattern."""
        return table.pattern(self.mask)


@dataclass(frozen=True)
class Seen:
    """One place of a line's lattice, as a pass saw it.

    Attributes
    ----------
    number : int
        Cell of the lattice, counted along the roll.
    mask : int
        As in `Cell`.
    dot_confidence : tuple of float, length 6
        As in `Cell`.
    certain : bool
        Whether every dot is certain.
    dots : ndarray, shape (6, 2)
        Its dots, raised or not, in the pass's mosaic: travel along the roll and place down the
        image, metres.
    stamp_ns : int
        As in `Cell`.
    """

    number: int
    mask: int
    dot_confidence: tuple[float, ...]
    certain: bool
    dots: F64
    stamp_ns: int
