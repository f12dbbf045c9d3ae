"""First cells of lines that aren't known for lines yet, read by what is in view ahead of them.

A line is begun when three cells of it were seen for long enough, and its first cell would wait for
the third. But when the first was seen for long enough, the others are in view already: where what
they show leaves no doubt, it needn't wait. The line is begun later all the same, as if nothing had
been given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .cell_reader import LOOKAHEAD_CELLS
from .cells import Seen
from .dots import DotFinder, Dots
from .kinds import Kind
from .lattice import Lattice
from .lattice_search import least_votes
from .lines import LineReader
from .reader_settings import BrailleSettings
from .strip import Strip

#: Time after which is looked again, seconds: it costs as much as reading some cells.
_AGAIN_S = 0.03
#: Wait for a line's third cell below which looking would cost as much time as it saves, seconds.
_WORTH_S = 0.06
#: Strength of dots, against the median, outside which they may be outliers or other relief. Tuned
#: on the virtual cell.
_ALIKE = (0.4, 2.5)

#: Finds the line from a place to another that explains dots best, and which of dots no line has.
FindLine = Callable[[dict[Kind, Dots], float, float], LineReader | None]
Free = Callable[[Dots], Dots]


@dataclass(frozen=True)
class Preview:
    """The beginning of a line."""

    #: Read as far as enough of it was in view; the pass goes on without it.
    line: LineReader
    #: Those of its first cells that were seen for long enough.
    cells: list[Seen]


class Previewer:
    """Looks for first cells."""

    def __init__(self, settings: BrailleSettings, strip: Strip, finder: DotFinder) -> None:
        self._strip, self._finder = strip, finder
        self._cell = settings.spacing.cell_pitch_m
        self._window = (LOOKAHEAD_CELLS + 1) * self._cell
        self._looked_s = 0.0
        # Place up to which must be seen for another look to give anything, metres.
        self._due = -np.inf

    def look(
        self, known: dict[Kind, Dots], upto: int, free: Free, find_line: FindLine
    ) -> list[Preview]:
        """Beginnings of lines, from the top.

        Parameters
        ----------
        known : dict
            Dots before column `upto`, by kind of events.
        upto : int
            Columns before this one were seen for long enough.
        free, find_line : callable
            See `Free` and `FindLine`.

        Returns
        -------
        list of Preview
            None at all if anything that lies there is in doubt.
        """
        strip = self._strip
        # Half a cell on, none can be complete yet.
        last = upto * strip.px_m - self._cell / 2
        wait_s = (self._window - self._cell) * strip.exposure.pace_s_m
        early = strip.exposure.rolled_s - self._looked_s < _AGAIN_S or upto * strip.px_m < self._due
        if wait_s < _WORTH_S or early or not _first(known) <= last:
            return []
        self._looked_s = strip.exposure.rolled_s
        self._due = upto * strip.px_m + self._cell / 2
        ahead = strip.exposure.glimpsed - self._finder.margin
        dots = {
            kind: before.joined(free(self._finder.find(strip, upto, ahead, kind, learn=False)))
            for kind, before in known.items()
        }
        votes = np.concatenate([part.votes for part in dots.values()])
        least = least_votes(votes)
        dots = {kind: part.where(part.votes >= least) for kind, part in dots.items()}
        out: list[Preview] = []
        while (start := _first(dots)) <= last:
            line = find_line(dots, start, start + self._window)
            if line is None:
                return []
            own = dots[line.kind].where(line.holds(dots[line.kind]))
            if not _clear(own, line.lattice):
                return []
            line.take(own.where(own.along >= start + self._window))
            line.advance(ahead)
            cells = line.early(upto)
            if not cells:
                self._due = -np.inf  # not enough of it was seen yet
                return []
            out.append(Preview(line, cells))
            dots = {kind: part.where(~line.holds(part)) for kind, part in dots.items()}
        self._due = min((p.line.end_of(p.cells[-1].number + 1) for p in out), default=self._due)
        return sorted(out, key=lambda p: p.line.top_at(p.line.start))


def _first(dots: dict[Kind, Dots]) -> float:
    """Where the first of dots lies along the roll, metres."""
    return min((float(part.along[0]) for part in dots.values() if len(part)), default=np.inf)


def _clear(dots: Dots, lattice: Lattice) -> bool:
    """Whether all dots lie on a lattice and are alike."""
    votes = dots.votes / np.median(dots.votes)
    alike = (votes >= _ALIKE[0]) & (votes <= _ALIKE[1])
    return bool((lattice.assign(dots)[0] & alike).all())
