"""Following one line of Braille along the roll."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from enum import Enum

import numpy as np
import numpy.typing as npt

from .cells import LEAST_CONFIDENCE, Seen
from .dot_shape import DotShape
from .dots import CHANCE, LEAST_VOTES, SPOT, Dots
from .ground import TAIL
from .kinds import Kind
from .lattice import Lattice
from .line_dots import LineDots
from .orientation import lifted, lower_row_free
from .reader_settings import Spacing
from .recognise import Energies, Reading, Recogniser, Reference, share
from .strip import Strip, image_around, net_around
from .warp import F32, F64

#: Cells seen beyond its first dot before a line is begun; lines above that are indented by less
#: come first.
LOOKAHEAD_CELLS = 2
#: Fewer dots are not taken for a line.
LEAST_DOTS = 3
#: Share of a cell's events that its dots hold at least; less is other relief.
LEAST_EXPLAINED = 0.6
#: More blank or foreign cells than this end a line.
_MOST_SPACES = 8
#: Cells behind whose dots hold the lattice.
_FIT_CELLS = 12
#: A tile with less than this, in a dot's events, is blank.
_BLANK = 1.0
#: Cells of other relief between two that are read which an accepted line may hold.
_FOREIGN = 2
#: Share of its events that a cell's dots hold, against that of the cells before, at which something
#: else lies in it, and at which nothing does; cells that this needs. Tuned on the virtual cell.
_SPOILT, _CLEAN, _FEW_CELLS = 0.7, 0.85, 3
#: Share of a typical dot's events that one above the line needs.
_LIFTS = 0.5
#: A dot is measured where it was found, if that is no further off its node, along and down.
_MOST_SHIFT_M = 0.0001
#: How far a printed coating moves the middle of a dot, by the dot's radius and by what it leaves of
#: the dot's events: the more, as under a dot nothing is taken off.
_MOVED = np.sqrt(0.5) / TAIL
#: Times that a line is restarted on a lattice a row or a column further.
_MOST_RESTARTS = 3
#: Least confidence of dots by which a line's first cells are given before the line is known.
_NO_DOUBT = 0.6
_UPPER_ROW, _LEFT_COLUMN = 0b001001, 0b000111


class _Kind(Enum):
    BLANK = 0
    READ = 1
    FOREIGN = 2


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
        self._strip, self._recogniser = strip, recogniser
        #: What its pitches are near to.
        self.spacing = spacing
        self.kind = kind
        self._direction = direction
        self._view = view
        self._dots = LineDots()
        self._shape, self._unseen = DotShape(spacing, strip.px_m), Dots.none()
        self._restarts = 0
        self._confirmed = lattice.begin
        #: Events of a typical dot where it was last read.
        self.typical = 0.0
        #: Whether its lattice may yet turn out to lie a row too low: text may be upside down.
        self.may_lift = True
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
        self._explained: deque[float] = deque(maxlen=_FIT_CELLS)
        self._unusual = 0
        self._raised = self._circles = 0
        #: Cells read and confirmed, in travel order.
        self.cells: list[Seen] = []

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
        return (self.lattice if self.accepted else self._origin).begin

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
        if len(dots):
            at = np.stack([dots.along, dots.down], -1)
            image, at = image_around(self._strip, at, self._recogniser.reach, self.kind)
            level = self._background(self.lattice)
            self._dots.add(dots, self._recogniser.halves(image, at, level))
            if self._strip.printed:
                self._unseen = self._unseen.joined(dots)

    def _learn_shape(self) -> None:
        """See what dots look like that lie on the line's lattice.

        First those it was laid under, then up to the next cell: farther on they might lie off it.
        """
        ahead = 1 if len(self._shape.dots) else LOOKAHEAD_CELLS
        now = self._unseen.along < self.lattice.moved(ahead).end
        dots, self._unseen = self._unseen.where(now), self._unseen.where(~now)
        dots = dots.where(self.lattice.assign(dots)[0])
        if len(dots):
            places = np.stack([dots.along, dots.down], -1)
            self._shape.add(*net_around(self._strip, places, self._shape.reach), dots)
            near = self._shape.dots
            if len(near) >= LEAST_DOTS:
                self.lattice = self.lattice.fitted(near, self.spacing)

    def advance(self, complete: int) -> None:
        """Read the cells whose tiles lie before a column."""
        while not self.closed and int(np.ceil(self.lattice.end / self._strip.px_m)) <= complete:
            self._read_next()
        if self.accepted and self._pending and not self.closed and not self._unusual:
            self._look_ahead()

    def early(self, complete: int) -> list[Seen]:
        """Its cells before a column, if nothing that was read of it is in doubt; else none."""
        if not self.accepted or self.closed or self._restarts or self._unusual:
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
        reference = self._reference(self.lattice)
        if reference is None:
            return
        if (self._measure(self.lattice)[3].whole > reference.trace).any():
            self.cells += self._pending
            self._pending = []

    def close(self) -> None:
        """Read no further."""
        if not self.accepted:
            self._judge(final=True)
        # A line on trial that is given up was at least none from its first cell on.
        self._confirmed = self.confirmed if self.accepted else self._origin.moved(1).begin
        self._pending = []
        self.closed = True

    def explained(self) -> float:
        """Share of events that its first dots hold, over as many cells as it takes to accept it."""
        reference = self._reference(self.lattice)
        if reference is None:
            return 0.0
        held = total = 0.0
        dots = 0
        for n in range(LOOKAHEAD_CELLS + 1):
            found = self._measure(self.lattice.moved(n))[3]
            filled = found.whole > reference.trace
            dots += int(filled.sum())
            held += float(found.whole[filled].sum())
            total += max(found.total, 0.0)
            if dots >= LEAST_DOTS:
                return share(held, total)
        return 0.0

    def _lift(self) -> None:
        """Move up by a row if the next cell has a dot above it and no cell one in its lowest row.

        Upright letters have dots in their upper row, so this is text upside down.
        """
        if not self.cells or not self._dots.above(self.lattice, _LIFTS * self.typical):
            return
        if lower_row_free(self.cells):
            self.cells, self._pending = (
                [lifted(seen) for seen in part] for part in (self.cells, self._pending)
            )
            self.lattice = self.lattice.shifted(0.0, -self.lattice.dot_down)

    def _read_next(self) -> None:
        if self._strip.printed:
            self._learn_shape()
        if self.may_lift:
            self._lift()
        kind, seen = self._read()
        if kind is _Kind.READ:
            if seen.certain:
                self._raised += seen.mask.bit_count()
            self.cells += [*self._pending, seen]
            self._pending = []
            self._unusual = 0
        elif self.cells or kind is _Kind.FOREIGN or self._next > LOOKAHEAD_CELLS:
            self._pending.append(seen)
            self._unusual += kind is _Kind.FOREIGN
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
        raised = 0
        for seen in self.cells:
            raised |= seen.mask if seen.certain else 0
        # A lattice is laid so that upper row and left column hold dots; where they turn out to
        # hold none, something that is no dot had a part in it.
        o = self._origin
        if not raised & _UPPER_ROW:
            o = o.shifted(0.0, o.dot_down)
        elif not raised & _LEFT_COLUMN:
            o = o.shifted(self._direction * o.dot_along, 0.0)
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
        if self.accepted:
            self._dots.forget_before(self.lattice.along - _FIT_CELLS * self.lattice.cell)
        near = self._shape.dots
        if len(near) < LEAST_DOTS:
            near = self._dots.before(self.lattice.along + 2 * self.lattice.cell)
        self.lattice = self.lattice.fitted(near, self.spacing).moved(1)
        self._next += 1

    def _background(self, lattice: Lattice) -> float:
        """Events a pixel where nothing is, around cell 0 of a lattice."""
        px = self._strip.px_m
        a, b = int(lattice.begin / px), int(lattice.moved(1).begin / px)
        return self._strip.background(a, b, self.kind)

    def _reference(self, lattice: Lattice) -> Reference | None:
        noise = self._background(lattice) * self._recogniser.area
        least = LEAST_VOTES + CHANCE * np.sqrt(max(noise, 0.0))
        return self._dots.reference(lattice, least)

    def _measure(self, lattice: Lattice) -> tuple[F64, F32, F64, Energies]:
        """Cell 0 of a lattice: its nodes, the image around, their place in it, their events."""
        strip, s = self._strip, self.spacing
        nodes = lattice.nodes(0) + self._dots.shift(lattice)
        image, at = image_around(strip, nodes, self._recogniser.margin, self.kind)
        # The nodes' place in the cut out image.
        offset = at[0] - [nodes[0, 0] / strip.px_m, strip.row(nodes[0, 1])]
        half = s.line_pitch_m / 2 * lattice.dot_down / s.dot_pitch_m
        corners = lattice.tile(half)
        tile = np.stack([corners[:, 0] / strip.px_m, strip.row(corners[:, 1])], -1) + offset
        off = self._dots.own_shifts(nodes, s.dot_pitch_m)
        at = at + np.clip(off, -_MOST_SHIFT_M, _MOST_SHIFT_M) / strip.px_m
        level = self._background(lattice)
        energies = self._recogniser.measure(image, at, tile, level)
        coating = strip.coating(self._recogniser.area) / np.maximum(energies.whole, 1e-9)
        moved = _MOVED * coating * SPOT * s.dot_diameter_m / 2
        off_m = np.maximum(np.hypot(off[:, 0], off[:, 1]) - moved, 0.0)
        return nodes, image, at, replace(energies, off_m=off_m)

    def _read(self) -> tuple[_Kind, Seen]:
        nodes, image, at, energies = self._measure(self.lattice)
        px = self._strip.px_m
        a, b = int(self.lattice.begin / px), int(self.lattice.moved(1).begin / px)
        stamp = self._strip.newest_ns(a, b)
        reference = self._reference(self.lattice)
        if reference is None:
            return _Kind.FOREIGN, self._seen(0, np.zeros(6), nodes, stamp)
        shaped = self._read_shape() if self._strip.printed else None
        reading = shaped or self._recogniser.read(image, at, energies, reference)
        outside = (nodes[:, 1] < self._view[0]) | (nodes[:, 1] > self._view[1])
        confidence = np.where(outside, 0.0, reading.confidence)
        mask = int((reading.raised << np.arange(6)).sum())
        raised = reading.raised
        if shaped:
            # A coating's spots now and then hold half a dot's pattern.
            raised = raised & (confidence >= LEAST_CONFIDENCE)
        if not raised.any() and reading.filled < _BLANK:
            return _Kind.BLANK, self._seen(0, confidence, nodes, stamp)
        if reading.explained < LEAST_EXPLAINED:
            # Its dots, if they are dots, are not to be trusted.
            doubt = reading.explained * LEAST_CONFIDENCE
            return _Kind.FOREIGN, self._seen(mask, confidence * doubt, nodes, stamp)
        if reading.raised.any():
            confidence = confidence * self._clean(reading.explained)
            self._explained.append(reading.explained)
        self._circles += reading.circles
        self.typical = reference.whole
        return _Kind.READ, self._seen(mask, confidence, nodes, stamp)

    def _read_shape(self) -> Reading | None:
        """Cell 0 of the lattice by what dots look like; None where that isn't known."""
        nodes = self.lattice.nodes(0)
        net, at = net_around(self._strip, nodes, self._shape.reach)
        return self._shape.read(net, at, self.lattice.begin, self.lattice.moved(1).begin)

    def _clean(self, explained: float) -> float:
        """How sure it is, 0 to 1, that a cell holds no other relief: against cells before it."""
        if len(self._explained) < _FEW_CELLS:
            return 1.0
        share = explained / float(np.median(self._explained))
        return float(np.clip((share - _SPOILT) / (_CLEAN - _SPOILT), 0.0, 1.0))

    def _seen(self, mask: int, confidence: F64, nodes: F64, stamp_ns: int) -> Seen:
        if self._direction < 0:
            mask = mask >> 3 | (mask & 7) << 3
            confidence = np.roll(confidence, 3)
            nodes = np.roll(nodes, 3, axis=0)
        certain = bool(confidence.min() >= LEAST_CONFIDENCE)
        sure = tuple(float(c) for c in confidence)
        return Seen(self._next, mask, sure, certain, nodes, stamp_ns)
