"""Following one line of Braille along the roll."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .cell_reader import FIT_CELLS, LEAST_DOTS, LOOKAHEAD_CELLS, CellKind, CellReader
from .cells import Seen
from .dots import Dots
from .kinds import Kind
from .lattice import Lattice
from .line_begin import ENOUGH_DOTS, KNOWN_DOTS, REACH_CELLS, certain_before, read_whole
from .line_shift import BETTER, column_leads, lacks, rows_fit_ahead
from .orientation import lifted, lower_row_free
from .reader_settings import Spacing
from .recognise import IN_PLACE_M, Recogniser
from .strip import Strip

#: More blank or foreign cells than this end a line.
_MOST_SPACES = 8
#: Cells of other relief between two that are read which an accepted line may hold.
_FOREIGN = 2
#: Share of a typical dot's events that one above the line needs.
_LIFTS = 0.5
#: Times that a line is restarted on a lattice a row or a column further.
_MOST_RESTARTS = 3
#: Least confidence of dots by which a line's first cells are given before the line is known.
_NO_DOUBT = 0.6
#: How much worse dots lie on other columns than on those thought, in dots, where these are right
#: for sure.
_SETTLED = 2.0


class LineReader:
    """One line: its lattice follows the dots, its cells are read as they pass.

    It is on trial until it holds enough certain dots, and cells enough were seen to know that its
    upper row and left column are where the lattice has them.

    Parameters
    ----------
    strip : Strip
        The pass's mosaic.
    recogniser : Recogniser
        Reads cells.
    lattice : Lattice
        Of the line's first cells; cell 0 is its first.
    spacing : Spacing
        What its pitches are near to.
    kind : Kind
        Events that it is read from.
    direction : int
        +1 when the sensor rolls along the camera's x axis, -1 against it.
    view : tuple of float
        First and last place down the image that is fully seen, metres.
    """

    def __init__(
        self,
        strip: Strip,
        recogniser: Recogniser,
        lattice: Lattice,
        spacing: Spacing,
        kind: Kind,
        direction: int,
        view: tuple[float, float],
    ) -> None:
        self._strip = strip
        self._reader = CellReader(strip, recogniser, spacing, kind, direction, view)
        #: What its pitches are near to.
        self.spacing = spacing
        self.kind = kind
        self._direction = direction
        self._restarts = 0
        self._confirmed = lattice.begin
        #: Whether its lattice may yet turn out to lie a row too low or a column too far, as under
        #: text upside down.
        self.may_be_turned = True
        #: Whether its rows may yet turn out to lie lower.
        self.may_be_lower = True
        # Whether the dots leave it open on which columns they lie, and the place up to which all
        # were seen.
        self._columns_open, self._seen_to = True, -np.inf
        #: Travel before which nothing is its own, metres.
        self.begins_after_m = -np.inf
        #: Whether it is known for a line of Braille.
        self.accepted = False
        #: Whether nothing more will be read.
        self.closed = False
        self._begin(lattice)

    def _begin(self, lattice: Lattice) -> None:
        self._origin = lattice
        #: Lattice whose cell 0 is the next to be read.
        self.lattice = lattice
        self._next = 0
        self._pending: list[Seen] = []
        self._reader.begin()
        self._unusual = 0
        self._raised = self._circles = 0
        #: Whether it is known where the line begins, so that its cells may be given.
        self.begun = False
        # Dots that were known when that was last looked for.
        self._known = KNOWN_DOTS - 1
        #: Cells read and confirmed, in travel order.
        self.cells: list[Seen] = []

    @property
    def typical(self) -> float:
        """Events of a typical dot where it was last read."""
        return self._reader.typical

    def top_at(self, along: float) -> float:
        """Distance down the image of the top row at a place along the roll, metres."""
        return self._origin.top_at(along)

    @property
    def start(self) -> float:
        """Travel at which its first cell begins, metres."""
        return self._origin.begin

    @property
    def needed_from(self) -> float:
        """Travel from which on the mosaic is still needed, metres."""
        if self._strip.printed and not self.begun:
            return max(self._origin.moved(-REACH_CELLS - 1).begin, self.begins_after_m)
        return (self._origin if self._may_restart else self.lattice).begin

    @property
    def _may_restart(self) -> bool:
        """Whether its lattice may yet turn out to be another, so that all is read again."""
        return not self.accepted or (self._columns_open and self.may_be_turned)

    @property
    def _due(self) -> float:
        """Travel at which its next cell can be read, metres."""
        if self._columns_open and self.may_be_turned and self._direction < 0:
            # Where it lies on the other columns it ends later.
            return self.lattice.shifted(self.lattice.dot_along, 0.0).end
        return self.lattice.end

    @property
    def confirmed(self) -> float:
        """Travel up to which what lies in its band is known to be its own or nothing, metres."""
        if self.closed:
            return self._confirmed
        if not self.accepted:
            return self._origin.begin
        return self.lattice.begin - len(self._pending) * self.lattice.cell

    def holds(self, dots: Dots) -> npt.NDArray[np.bool_]:
        """Which dots lie in the line's band, shape (n,)."""
        _, down = self.lattice.own(dots)
        half = (self.spacing.line_pitch_m - 2 * self.spacing.dot_pitch_m) / 2
        return np.asarray((down > -half) & (down < 2 * self.lattice.dot_down + half))

    def take(self, dots: Dots) -> None:
        """Take newly found dots of its band."""
        self._reader.take(dots, self.lattice)

    def read_back(self, dots: Dots) -> None:
        """Begin with cells before the first that are certain, and whose dots began no line.

        A line's first cells may have too few dots for it, as those of a capital a.
        """
        on, index = self.lattice.assign(dots)
        # Dots of other relief may lie near a node, too; these have no line around them yet.
        on &= self.lattice.off(dots) <= IN_PLACE_M
        self._reader.take(dots.where(on), self.lattice)
        n = certain_before(self._reader, self.lattice, set(index[on, 0].tolist()))
        self._begin(self.lattice.moved(-n))
        self._confirmed = self.lattice.begin

    def advance(self, complete: int, final: bool = False) -> None:
        """Read the cells whose tiles lie before a column, all there are if no more will come."""
        while not self.closed:
            due = self.lattice.end if final else self._due
            if int(np.ceil(due / self._strip.px_m)) > complete:
                break
            self._seen_to = max(self._seen_to, due)
            self._read_next()
        if self.accepted and not self.begun:
            self._find_begin(final=False)
        if self.accepted and self._pending and not self.closed and not self._unusual:
            self._look_ahead()

    def early(self, complete: int) -> list[Seen]:
        """Its cells before a column, if nothing that was read of it is in doubt; else none."""
        if not self.begun or self.closed or self._restarts or self._unusual:
            return []
        if self.cells[0].number or min(min(c.dot_confidence) for c in self.cells) < _NO_DOUBT:
            return []
        limit = complete * self._strip.px_m
        return [c for c in self.cells if self.end_of(c.number) <= limit]

    def end_of(self, n: int) -> float:
        """Travel at which all of the line's cell n was passed, metres."""
        return self.lattice.moved(n - self._next).end

    def _look_ahead(self) -> None:
        """Let blank cells stand for spaces as soon as the next cell, half seen, shows a dot."""
        if self.lattice.centre(0)[0] > self._strip.exposure.half_seen * self._strip.px_m:
            return
        reference = self._reader.reference(self.lattice)
        if reference is None:
            return
        if (self._reader.measure(self.lattice)[3].whole > reference.trace).any():
            self.cells += self._pending
            self._pending = []

    def close(self) -> None:
        """Read no further."""
        if not self.accepted:
            self._judge(final=True)
        if self.accepted and not self.begun:
            self._find_begin(final=True)
        # A line on trial that is given up was at least none from its first cell on.
        self._confirmed = self.confirmed if self.accepted else self._origin.moved(1).begin
        self._pending = []
        self.closed = True

    def _find_begin(self, final: bool) -> None:
        """See on a printed coating which cells come before its first, and read anew what is open.

        `final`: what is in doubt now remains so.
        """
        if self._strip.printed:
            known = self._reader.shape_dots
            if not final and known <= self._known:
                return
            self._known = known
            first, limit_m = self.lattice.moved(-self._next), self.begins_after_m
            cells, n, sure = read_whole(self._reader, first, self.cells, limit_m, _MOST_SPACES)
            if not (final or sure or known >= ENOUGH_DOTS):
                return
            self.cells, self._origin = cells, self._origin.moved(-n)
            self._next += n
        self.begun = True

    def explained(self) -> float:
        """Share of events that its first dots hold, over as many cells as it takes to accept it."""
        return self._reader.explained(self.lattice)

    def _lift(self) -> None:
        """Move up by a row if the next cell has a dot above it and no cell one in its lowest row.

        Upright letters have dots in their upper row, so this is text upside down.
        """
        if not self.cells or not self._reader.dots.above(self.lattice, _LIFTS * self.typical):
            return
        if lower_row_free(self.cells):
            self.cells, self._pending = (
                [lifted(seen) for seen in part] for part in (self.cells, self._pending)
            )
            self.lattice = self.lattice.shifted(0.0, -self.lattice.dot_down)

    def _column_leads(self) -> dict[int, float]:
        return column_leads(self._reader, self.lattice, self.spacing, self._seen_to)

    def _change_columns(self) -> bool:
        """Restart if the dots lie better on columns beside those thought; say whether it was."""
        leads = self._column_leads()
        side, lead = max(leads.items(), key=lambda each: each[1])
        if lead > BETTER and self._restarts < _MOST_RESTARTS:
            self._restarts += 1
            self._begin(self._origin.shifted(side * self._origin.dot_along, 0.0))
            return True
        self._columns_open = lead > -_SETTLED and self._next < FIT_CELLS
        return False

    def _read_next(self) -> None:
        self.lattice = self._reader.learn_shape(self.lattice)
        if self.may_be_turned:
            if self._columns_open and self._change_columns():
                return
            self._lift()
        kind, seen, circles = self._reader.read(self.lattice, self._next)
        if self._strip.printed and not self._next and kind is CellKind.BLANK and seen.certain:
            # What it was begun with was no dot but a coating's spots.
            self.close()
            return
        self._circles += circles
        if kind is CellKind.READ:
            if seen.certain:
                self._raised += seen.mask.bit_count()
            self.cells += [*self._pending, seen]
            self._pending = []
            self._unusual = 0
        elif self.cells or kind is CellKind.FOREIGN or self._next > LOOKAHEAD_CELLS:
            self._pending.append(seen)
            self._unusual += kind is CellKind.FOREIGN
        self._follow()
        if not self.accepted:
            enough = bool(self.cells) and self._next - self.cells[0].number > LOOKAHEAD_CELLS
            if (enough or self._unusual) and self._judge(final=False):
                return
        most = _FOREIGN if self.accepted else 0
        if self._unusual > most or len(self._pending) > _MOST_SPACES:
            self.close()

    def _judge(self, final: bool) -> bool:
        """Accept the line, or restart where its rows or columns are not those thought.

        Parameters
        ----------
        final : bool
            Whether no more will be read: then it is not restarted.

        Returns
        -------
        bool
            Whether it was restarted.
        """
        if self._raised < LEAST_DOTS or 2 * self._circles < self._raised:
            return False
        ahead = self._direction
        # A lattice is laid so that upper row and left column hold dots; where they turn out to
        # hold none, something that is no dot had a part in it, or text is upside down.
        no_upper, no_left = lacks(self.cells)
        o = self._origin
        if no_upper and self.may_be_lower and not rows_fit_ahead(self._reader, self.lattice):
            o = o.shifted(0.0, o.dot_down)
        elif no_left and self._column_leads()[ahead] > -BETTER:
            o = o.shifted(ahead * o.dot_along, 0.0)
        else:
            self.accepted = True
            return False
        self._restarts += 1
        if self._restarts > _MOST_RESTARTS or final:
            return False
        self._begin(o)
        return True

    def _follow(self) -> None:
        """Fit the lattice to the dots up to here and step to the next cell."""
        if not self._may_restart:
            self._reader.dots.forget_before(self.lattice.along - FIT_CELLS * self.lattice.cell)
        near = self._reader.placed(self.lattice.along + 2 * self.lattice.cell)
        self.lattice = self.lattice.fitted(near, self.spacing).moved(1)
        self._next += 1
