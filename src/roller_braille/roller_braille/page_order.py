"""The order in which lines are read, by where they lie."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .reader_settings import Spacing
from .warp import F64

#: Lines whose directions differ by more than this are of different pages: cosine, of 20°.
_ONE_PAGE = 0.94
#: Lines side by side in a row, no further apart than this, in cells, are read one after the other;
#: a line goes on over as many spaces.
_MOST_SPACES = 8


class PageOrder:
    """Lines as a page has them: from the top, and from the left where they lie side by side.

    Of lines that are neither above one another nor in one row, as those of plates beside each
    other, the one that came first is read first.

    Parameters
    ----------
    spacing : Spacing
        What the pitches of lines and cells are near to.
    """

    def __init__(self, spacing: Spacing) -> None:
        self._row_m = spacing.line_pitch_m / 2
        self._beside_m = _MOST_SPACES * spacing.cell_pitch_m
        # Of each line the first dot's place, axes along the line and down the page, and its ends.
        self._places = np.empty((0, 3, 3))
        self._ends = np.empty((0, 2))
        #: Numbers of lines in reading order.
        self.lines: list[int] = []

    def take(self, line: int, dots: F64) -> None:
        """Take a cell of a line, the next one or one of those before.

        Parameters
        ----------
        line : int
            Its number; that of a new line is one more than those so far.
        dots : ndarray of float64, shape (6, 3)
            Places of the cell's dots in base, metres.
        """
        right, down = dots[3] - dots[0], dots[1] - dots[0]
        if line == len(self._places):
            axes = right / np.linalg.norm(right), down / np.linalg.norm(down)
            self._places = np.append(self._places, [[dots[0], *axes]], axis=0)
            self._ends = np.append(self._ends, [[0.0, 0.0]], axis=0)
            self.lines.append(line)
        first, along, _ = self._places[line]
        at = (dots[[0, 3]] - first) @ along
        self._ends[line] = min(self._ends[line, 0], at[0]), max(self._ends[line, 1], at[1])
        if len(self.lines) > 1:
            self._move(line)

    def _move(self, line: int) -> None:
        """Move a line to where it belongs among the others."""
        before, after = self._beside(line)
        place = self.lines.index(line)
        del self.lines[place]
        order = np.array(self.lines)
        if after[order].any():
            place = int(np.argmax(after[order]))
        elif before[order].any():
            place = len(order) - int(np.argmax(before[order][::-1]))
        self.lines.insert(place, line)

    def _beside(self, line: int) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Which lines are read before one, and which after it, shape (n,)."""
        first, along, down = self._places[line]
        away = self._places[:, 0] - first
        below, right = away @ down, away @ along
        page = self._places[:, 1] @ along > _ONE_PAGE
        begin, end = self._ends[line]
        begins, ends = right + self._ends[:, 0], right + self._ends[:, 1]
        over = page & (begins <= end) & (ends >= begin)
        row = page & (np.abs(below) <= self._row_m)
        row &= (begins <= end + self._beside_m) & (ends >= begin - self._beside_m)
        row[line] = False
        before = over & (below < -self._row_m) | row & (right < 0)
        after = over & (below > self._row_m) | row & (right >= 0)
        return before, after
