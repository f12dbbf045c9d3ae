"""Where a line begins: cells before those that it was found by.

What dots look like under a printed coating is learnt from the line itself. Its first cells are read
when that is known from few dots, and those before them may have had too few to begin a line with.
Once more dots are known all of them are read again: a place before the line is judged like any
other, and an empty one shows next to nothing of the pattern.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

from .cell_reader import LOOKAHEAD_CELLS, CellKind, CellReader
from .cells import Seen
from .lattice import Lattice

#: Cells before a line's first that are looked at: as many as a line may have.
REACH_CELLS = 20
#: Dots from which on the pattern is known well enough to find cells by it that began no line, and
#: dots beyond which waiting for more doesn't help.
KNOWN_DOTS, ENOUGH_DOTS = 6, 16


def certain_before(reader: CellReader, lattice: Lattice, begun_by: Container[int]) -> int:
    """How many cells before a new line's first are its own, as all up to them are certain.

    Parameters
    ----------
    reader : CellReader
        The line's.
    lattice : Lattice
        Its cell 0 is the first, as it was found.
    begun_by : container of int
        Cells, by their numbers, with dots that began no line.
    """
    first = 0
    for n in range(1, LOOKAHEAD_CELLS + 2):
        kind, seen, _ = reader.read(lattice.moved(-n), 0)
        if not seen.certain or kind is CellKind.FOREIGN:
            break
        if kind is CellKind.READ:
            if -n not in begun_by:
                break
            first = n
    return first


def read_whole(
    reader: CellReader, first: Lattice, cells: list[Seen], limit_m: float, most_spaces: int
) -> tuple[list[Seen], int, bool]:
    """A line's cells with those before its first, counted anew; those in doubt read again.

    Parameters
    ----------
    reader, first, cells
        See `read_again`.
    limit_m, most_spaces
        See `read_before`.

    Returns
    -------
    tuple
        The cells, how many came before, and whether none is in doubt.
    """
    cells = read_again(reader, first, cells)
    before, sure = read_before(reader, first, limit_m, most_spaces)
    n = -before[0].number if before else 0
    numbered = [replace(seen, number=seen.number + n) for seen in before + cells]
    return numbered, n, sure and all(seen.certain for seen in cells)


def read_again(reader: CellReader, first: Lattice, cells: list[Seen]) -> list[Seen]:
    """Cells of a line, those in doubt as they are read now.

    Parameters
    ----------
    reader : CellReader
        The line's.
    first : Lattice
        Its cell 0 is the line's.
    cells : list of Seen
        In travel order.
    """
    out = []
    for seen in cells:
        if not seen.certain:
            kind, now, _ = reader.read(first.moved(seen.number), seen.number)
            if now.certain and kind is not CellKind.FOREIGN:
                seen = replace(now, stamp_ns=seen.stamp_ns)
        out.append(seen)
    return out


def read_before(
    reader: CellReader, first: Lattice, limit_m: float, most_spaces: int
) -> tuple[list[Seen], bool]:
    """Cells before a line's first, in travel order.

    Parameters
    ----------
    reader, first
        See `read_again`.
    limit_m : float
        Travel before which nothing is its own, metres.
    most_spaces : int
        More blank cells than this end a line.

    Returns
    -------
    tuple
        Cells from the first that shows dots on, and whether nothing that was looked at is in doubt.
    """
    found: list[Seen] = []
    blank: list[Seen] = []
    for n in range(1, REACH_CELLS + 1):
        lattice = first.moved(-n)
        if lattice.begin < limit_m or not reader.in_view(lattice):
            break
        kind, seen, _ = reader.read(lattice, -n)
        if not seen.certain or kind is CellKind.FOREIGN:
            return found[::-1], False
        blank.append(seen)
        if kind is CellKind.READ:
            found += blank
            blank = []
        elif len(blank) > most_spaces:
            break
    return found[::-1], True
