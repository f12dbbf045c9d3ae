"""Finding out whether text is upside down, and turning it.

Every cell turned by 180° is another cell, and of most letters one that stands for none: print reads
as print only upright. What cells say is weighed by how often they occur, upright and upside down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from . import table
from .cells import LEAST_CONFIDENCE, Seen

#: Letters among a thousand of English print; other languages are near enough for this.
_FREQUENCY = {
    "e": 127, "t": 91, "a": 82, "o": 75, "i": 70, "n": 67, "s": 63, "h": 61, "r": 60, "d": 43,
    "l": 40, "c": 28, "u": 28, "m": 24, "w": 24, "f": 22, "g": 20, "y": 20, "p": 19, "b": 15,
    "v": 10, "k": 8, "j": 2, "x": 2, "q": 1, "z": 1,
}  # fmt: skip
#: Least share of a letter, and that of a sign, among cells; that of cells without a meaning in
#: grade 1, and in a contracted code, where nearly all have one.
_LETTER, _SIGN, _NONE, _CONTRACTED = 0.005, 0.005, 0.001, 0.01
_UPPER_ROW, _UPPER_TWO, _LOWER_ROW = 0b001001, 0b011011, 0b100100
_LEFT = 0b000111
#: Log odds at which an orientation is taken, at first and when no more will come, and cells after
#: which the question is dropped.
SURE, LIKELY, MOST_CELLS = 7.0, 3.5, 12


def turned(mask: int) -> int:
    """A cell's mask upside down: dot 1 becomes dot 6, and so on."""
    return int(f"{mask:06b}"[::-1], 2)


@cache
def _log_shares(code: str) -> tuple[float, ...]:
    share = np.full(64, _CONTRACTED if code == "ueb2" else _NONE)
    for mask in (
        *table.PUNCTUATION.values(), table.NUMBER_SIGN, table.CAPITAL_SIGN, table.LETTER_SIGN,
    ):  # fmt: skip
        share[mask] = max(share[mask], _SIGN)
    for letter, count in _FREQUENCY.items():
        share[table.LETTERS[letter]] = max(count * 1e-3, _LETTER)
    share[table.SPACE] = 1.0
    return tuple(float(v) for v in np.log(share))


def log_odds(cells: Sequence[Seen], code: str) -> float:
    """How much more likely the cells of a line are upright than upside down.

    Parameters
    ----------
    cells : sequence of Seen
        Cells of one line; only certain ones count.
    code : str
        The setting `code`.

    Returns
    -------
    float
        Natural logarithm; below 0 they are rather upside down.
    """
    share = _log_shares(code)
    masks = [seen.mask for seen in cells if seen.certain]
    down, right = _moves(masks)
    return sum(share[m] - share[turned(_moved(m, down, right))] for m in masks)


def upside_down(cells: Sequence[Seen]) -> list[Seen]:
    """The cells of a line as they are when it is turned, in the order they were seen."""
    down, right = _moves([seen.mask for seen in cells if seen.certain])
    return [_turned_cell(_moved_cell(seen, down, right)) for seen in cells]


def lifted(seen: Seen) -> Seen:
    """A cell as a lattice has it that lies a row higher: its own rows are the lower two."""
    return _moved_cell(seen, 1, 0)


def lower_row_free(cells: Sequence[Seen]) -> bool:
    """Whether no cell has a dot in its lowest row."""
    return not any(seen.mask & _LOWER_ROW for seen in cells)


def _moves(masks: Sequence[int]) -> tuple[int, int]:
    """Rows and columns by which a line lies too high and too far left for text upside down.

    Lattices are laid so that upper row and left column hold dots. Text that is upside down has them
    in the lower row and the right column, for upright every letter has dots in its upper row.
    """
    used = 0
    for mask in masks:
        used |= mask
    if not used:
        return 0, 0
    down = 0 if used & _LOWER_ROW else (1 if used & ~_UPPER_ROW else 2)
    return down, int(used & _LEFT == used)


def _moved(mask: int, down: int, right: int) -> int:
    for _ in range(down):
        mask = (mask & _UPPER_TWO) << 1
    return (mask & _LEFT) << 3 if right else mask


def _moved_cell(seen: Seen, down: int, right: int) -> Seen:
    """The cell of a lattice whose origin lies so many rows above and columns before this one's."""
    if not down and not right:
        return seen
    kept = np.reshape(seen.dot_confidence, (2, 3))[: 2 - right, : 3 - down]
    # What comes in was not measured by itself: it is as sure as the rest.
    confidence = np.full((2, 3), kept.min())
    confidence[right:, down:] = kept
    nodes = seen.dots
    back = right * (nodes[3] - nodes[0]) + down * (nodes[1] - nodes[0])
    return replace(
        seen,
        mask=_moved(seen.mask, down, right),
        dot_confidence=tuple(float(c) for c in confidence.ravel()),
        certain=bool(kept.min() >= LEAST_CONFIDENCE),
        dots=nodes - back,
    )


def _turned_cell(seen: Seen) -> Seen:
    return replace(
        seen,
        mask=turned(seen.mask),
        dot_confidence=seen.dot_confidence[::-1],
        dots=seen.dots[::-1],
    )
