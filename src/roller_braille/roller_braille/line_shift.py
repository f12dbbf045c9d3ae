"""Whether dots lie better on the columns or rows beside those that a line was thought to have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .cell_reader import CellReader
from .cells import Seen
from .lattice import Lattice
from .reader_settings import Spacing

#: How much better dots lie on other columns or rows than on those thought, in dots, where these are
#: wrong.
BETTER = 0.5
_UPPER_ROW, _LEFT_COLUMN = 0b001001, 0b000111


def lacks(cells: Sequence[Seen]) -> tuple[bool, bool]:
    """Whether no cell that is certain has a dot in its upper row, and none in its left column."""
    raised = 0
    for seen in cells:
        raised |= seen.mask if seen.certain else 0
    return not raised & _UPPER_ROW, not raised & _LEFT_COLUMN


def column_leads(
    reader: CellReader, lattice: Lattice, spacing: Spacing, seen_to_m: float
) -> dict[int, float]:
    """How much better the dots lie on columns a dot's pitch back (-1) and on (1), in dots.

    Dots of one column fit either; the left one is taken then. That text is upside down and they are
    in the right one shows when dots of two columns come: those of a cell are nearer to each other
    than those of neighbouring cells.

    Parameters
    ----------
    reader : CellReader
        The line's.
    lattice : Lattice
        As it was thought.
    spacing : Spacing
        What its pitches are near to.
    seen_to_m : float
        Travel up to which all dots were seen, metres.
    """
    step = lattice.dot_along
    lattices = {side: lattice.shifted(side * step, 0.0) for side in (-1, 0, 1)}
    dots = reader.spots(seen_to_m, list(lattices.values()))
    fits = {side: each.fitted(dots, spacing).column_fit(dots) for side, each in lattices.items()}
    own = fits.pop(0)
    return {side: fit - own for side, fit in fits.items()}


def rows_fit_ahead(reader: CellReader, lattice: Lattice) -> bool:
    """Whether dots of cells to come fit the lattice better than one a row lower.

    A hyphen and a capital sign have dots in the lowest row alone.

    Parameters
    ----------
    reader : CellReader
        The line's.
    lattice : Lattice
        Its cell 0 is the next to be read.
    """
    lower = lattice.shifted(0.0, lattice.dot_down)
    dots = reader.spots(np.inf, [lattice])
    ahead = dots.where(dots.along >= lattice.begin)
    return lattice.fit_of(ahead) > lower.fit_of(ahead) + BETTER
