"""What the reader gives: cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from . import table
from .warp import F64

#: A cell with a dot less certain than this isn't read.
LEAST_CONFIDENCE = 0.4


@dataclass(frozen=True)
class Cell:
    """One Braille cell read from the surface."""

    #: Time of the newest event seen over the cell, ROS time, ns.
    stamp_ns: int
    #: Where it stands in the text, from 0.
    line: int
    column: int
    #: Raised dots as far as seen: dot 1 is bit 0 … dot 6 is bit 5.
    mask: int
    #: What it stands for, given the cells before it; empty for a sign (number, capital, letter) and
    #: for a cell that is not readable.
    character: str
    #: Whether dots and character are certain.
    readable: bool
    #: Its middle in base, metres. Shape (3,).
    position: F64
    #: How sure the reading is, 0 to 1: that of the least certain dot.
    confidence: float
    #: How sure each dot is (raised or not). Length 6.
    dot_confidence: tuple[float, ...]
    #: Where its six dots are, raised or not, in base, metres. Shape (6, 3).
    dot_positions: F64

    @property
    def pattern(self) -> str:
        """The dots as one Unicode Braille pattern."""
        return table.pattern(self.mask)


@dataclass(frozen=True)
class Seen:
    """One place of a line's lattice, as a pass saw it."""

    #: Cell of the lattice, counted along the roll.
    number: int
    #: As in `Cell`.
    mask: int
    #: As in `Cell`. Length 6.
    dot_confidence: tuple[float, ...]
    #: Whether every dot is certain.
    certain: bool
    #: Its dots, raised or not, in the pass's mosaic: travel along the roll and place down the
    #: image, metres. Shape (6, 2).
    dots: F64
    #: As in `Cell`.
    stamp_ns: int


def certain_dots(confidence: Sequence[float]) -> int:
    """Mask of the dots that are certain, raised or not."""
    return sum(1 << i for i, c in enumerate(confidence) if c >= LEAST_CONFIDENCE)
