"""Reading single cells of a line from the mosaic."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

import numpy as np
import numpy.typing as npt

from .cells import LEAST_CONFIDENCE, Seen
from .dot_centre import DotCentre
from .dot_shape import DotShape, alike
from .dots import CHANCE, LEAST_VOTES, SPOT, Dots
from .ground import TAIL
from .kinds import Kind
from .lattice import REACH, Lattice
from .line_dots import LineDots
from .reader_settings import Spacing
from .recognise import Energies, Reading, Recogniser, Reference, share
from .strip import Strip, image_around, net_around
from .warp import F32, F64

#: Share of a cell's events that its dots hold at least; less is other relief.
LEAST_EXPLAINED = 0.6
#: Cells behind whose dots hold the lattice, and tell what is usual.
FIT_CELLS = 12
#: Fewer dots are not taken for a line.
LEAST_DOTS = 3
#: Cells seen beyond its first dot before a line is begun; lines above that are indented by less
#: come first.
LOOKAHEAD_CELLS = 2
#: A tile with less than this, in a dot's events, is blank.
_BLANK = 1.0
#: Share of its events that a cell's dots hold, against that of the cells before, at which something
#: else lies in it, and at which nothing does; cells that this needs. Tuned on the virtual cell.
_SPOILT, _CLEAN, _FEW_CELLS = 0.7, 0.85, 3
#: A dot is measured where it was found, if that is no further off its node, along and down.
_MOST_SHIFT_M = 0.0001
#: How far a printed coating moves the middle of a dot, by the dot's radius and by what it leaves of
#: the dot's events: the more, as under a dot nothing is taken off.
_MOVED = np.sqrt(0.5) / TAIL


class CellKind(Enum):
    """What a cell of a line's lattice turned out to be."""

    BLANK = 0
    READ = 1
    FOREIGN = 2


class CellReader:
    """Reads the cells of one line.

    Parameters
    ----------
    strip : Strip
        The pass's mosaic.
    recogniser : Recogniser
        Tells which dots of a cell are raised.
    spacing : Spacing
        Of the line.
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
        spacing: Spacing,
        kind: Kind,
        direction: int,
        view: tuple[float, float],
    ) -> None:
        self._strip, self._recogniser, self._spacing = strip, recogniser, spacing
        self.kind = kind
        self._direction, self._view = direction, view
        #: Spots in the line's band.
        self.dots = LineDots()
        self._shape, self._unseen = DotShape(spacing, strip.px_m), Dots.none()
        self._centre = DotCentre(spacing, strip.px_m)
        self._explained: deque[float] = deque(maxlen=FIT_CELLS)
        #: Events of a typical dot where a cell was last read.
        self.typical = 0.0

    def begin(self) -> None:
        """Cells are read from the line's first one on."""
        self._explained.clear()

    def take(self, dots: Dots, lattice: Lattice) -> None:
        """Take newly found dots of the line's band; cell 0 of the lattice is the next."""
        if len(dots):
            at = np.stack([dots.along, dots.down], -1)
            image, at = image_around(self._strip, at, self._recogniser.reach, self.kind)
            level = self._background(lattice)
            self.dots.add(dots, self._recogniser.halves(image, at, level))
            if self._strip.printed:
                self._unseen = self._unseen.joined(dots)

    def learn_shape(self, lattice: Lattice) -> Lattice:
        """See what dots look like on a printed coating.

        First those that the line's lattice was laid under, then up to the next cell: farther on
        they might lie off it.

        Parameters
        ----------
        lattice : Lattice
            Its cell 0 is the next to be read.

        Returns
        -------
        Lattice
            Laid under the dots where they look alike.
        """
        if not self._strip.printed:
            return lattice
        ahead = 1 if len(self._shape.dots) else LOOKAHEAD_CELLS
        now = self._unseen.along < lattice.moved(ahead).end
        dots, self._unseen = self._unseen.where(now), self._unseen.where(~now)
        dots = dots.where(lattice.assign(dots)[0])
        if len(dots):
            places = np.stack([dots.along, dots.down], -1)
            self._shape.add(*net_around(self._strip, places, self._shape.reach), dots)
            near = self._shape.dots
            if len(near) >= LEAST_DOTS:
                return lattice.fitted(near, self._spacing)
        return lattice

    def placed(self, along: float) -> Dots:
        """Dots that the lattice is to lie under, where found before a place along the roll."""
        near = self._shape.dots
        return near if len(near) >= LEAST_DOTS else self.dots.before(along)

    def spots(self, along: float, lattices: Sequence[Lattice]) -> Dots:
        """Dots found before a place along the roll, also those off the line's own lattice.

        On a printed coating, with spots all over it, those that look alike on the columns of some
        lattices.
        """
        dots = self.dots.before(along)
        if self._strip.printed and len(dots):
            off = np.min([lattice.column_off(dots) for lattice in lattices], axis=0)
            near = dots.where(off <= REACH * self._spacing.dot_pitch_m)
            dots = alike(self._strip, self._spacing, near)
        return dots

    def reference(self, lattice: Lattice) -> Reference | None:
        """What a dot looks like around cell 0 of a lattice; None where too little is known."""
        noise = self._background(lattice) * self._recogniser.area
        least = LEAST_VOTES + CHANCE * np.sqrt(max(noise, 0.0))
        return self.dots.reference(lattice, least)

    def measure(self, lattice: Lattice) -> tuple[F64, F32, F64, Energies]:
        """Cell 0 of a lattice: its nodes, the image around, their place in it, their events."""
        strip, s = self._strip, self._spacing
        nodes = lattice.nodes(0) + self.dots.shift(lattice)
        image, at = image_around(strip, nodes, self._recogniser.margin, self.kind)
        # The nodes' place in the cut out image.
        offset = at[0] - [nodes[0, 0] / strip.px_m, strip.row(nodes[0, 1])]
        half = s.line_pitch_m / 2 * lattice.dot_down / s.dot_pitch_m
        corners = lattice.tile(half)
        tile = np.stack([corners[:, 0] / strip.px_m, strip.row(corners[:, 1])], -1) + offset
        off = self.dots.own_shifts(nodes, s.dot_pitch_m)
        at = at + np.clip(off, -_MOST_SHIFT_M, _MOST_SHIFT_M) / strip.px_m
        level = self._background(lattice)
        energies = self._recogniser.measure(image, at, tile, level)
        coating = strip.coating(self._recogniser.area) / np.maximum(energies.whole, 1e-9)
        moved = _MOVED * coating * SPOT * s.dot_diameter_m / 2
        off_m = np.maximum(np.hypot(off[:, 0], off[:, 1]) - moved, 0.0)
        return nodes, image, at, replace(energies, off_m=off_m)

    def read(self, lattice: Lattice, number: int) -> tuple[CellKind, Seen, int]:
        """Read cell 0 of a lattice.

        Parameters
        ----------
        lattice : Lattice
            Where it lies.
        number : int
            Its number in the line.

        Returns
        -------
        tuple
            What it is, what was seen of it, and dots that show as circles.
        """
        nodes = lattice.nodes(0) + self.dots.shift(lattice)
        px = self._strip.px_m
        a, b = int(lattice.begin / px), int(lattice.moved(1).begin / px)
        stamp = self._strip.newest_ns(a, b)
        reference = self.reference(lattice)
        if reference is None:
            return CellKind.FOREIGN, self._seen(number, 0, np.zeros(6), nodes, stamp), 0
        shaped = self._read_shape(lattice) if self._strip.printed else None
        if shaped:
            reading = shaped
        else:
            _, image, at, energies = self.measure(lattice)
            reading = self._recogniser.read(image, at, energies, reference)
        confidence = np.where(self._in_view(nodes), reading.confidence, 0.0)
        mask = int((reading.raised << np.arange(6)).sum())
        raised = reading.raised
        if shaped:
            # A coating's spots now and then hold half a dot's pattern.
            raised = raised & (confidence >= LEAST_CONFIDENCE)
        if not raised.any() and reading.filled < _BLANK:
            return CellKind.BLANK, self._seen(number, 0, confidence, nodes, stamp), 0
        if reading.explained < LEAST_EXPLAINED:
            # Its dots, if they are dots, are not to be trusted.
            doubt = reading.explained * LEAST_CONFIDENCE
            return CellKind.FOREIGN, self._seen(number, mask, confidence * doubt, nodes, stamp), 0
        if reading.raised.any():
            confidence = confidence * self._clean(reading.explained)
            self._explained.append(reading.explained)
        self.typical = reference.whole
        if raised.any():
            self._centre.add(*net_around(self._strip, nodes[raised], self._centre.margin))
        return (
            CellKind.READ,
            self._seen(number, mask, confidence, nodes, stamp),
            reading.circles,
        )

    def explained(self, lattice: Lattice) -> float:
        """Share of events that the first dots hold, over as many cells as accept a line."""
        reference = self.reference(lattice)
        if reference is None:
            return 0.0
        held = total = 0.0
        dots = 0
        for n in range(LOOKAHEAD_CELLS + 1):
            found = self.measure(lattice.moved(n))[3]
            filled = found.whole > reference.trace
            dots += int(filled.sum())
            held += float(found.whole[filled].sum())
            total += max(found.total, 0.0)
            if dots >= LEAST_DOTS:
                return share(held, total)
        return 0.0

    def in_view(self, lattice: Lattice) -> bool:
        """Whether all of cell 0 of a lattice was seen for long enough."""
        return bool(self._in_view(lattice.nodes(0)).all())

    @property
    def shape_dots(self) -> int:
        """Dots by which it is known what dots look like on a printed coating."""
        return len(self._shape.dots)

    def _in_view(self, nodes: F64) -> npt.NDArray[np.bool_]:
        """At which nodes a dot would have been seen, all of it and for long enough, shape (6,)."""
        seen = (nodes[:, 1] >= self._view[0]) & (nodes[:, 1] <= self._view[1])
        # Where a pass begins and ends there are columns that it hardly saw: without events, but
        # nobody knows whether they are empty.
        half = SPOT * self._spacing.dot_diameter_m / 2
        for side in (-half, half):
            seen &= self._strip.exposure.shown(nodes[:, 0] + side)
        return np.asarray(seen)

    def _background(self, lattice: Lattice) -> float:
        """Events a pixel where nothing is, around cell 0 of a lattice."""
        px = self._strip.px_m
        a, b = int(lattice.begin / px), int(lattice.moved(1).begin / px)
        return self._strip.background(a, b, self.kind)

    def _read_shape(self, lattice: Lattice) -> Reading | None:
        """Cell 0 of a lattice by what dots look like; None where that isn't known."""
        nodes = lattice.nodes(0)
        net, at = net_around(self._strip, nodes, self._shape.reach)
        return self._shape.read(net, at, lattice.begin, lattice.moved(1).begin)

    def _clean(self, explained: float) -> float:
        """How sure it is, 0 to 1, that a cell holds no other relief: against cells before it."""
        if len(self._explained) < _FEW_CELLS:
            return 1.0
        usual = explained / float(np.median(self._explained))
        return float(np.clip((usual - _SPOILT) / (_CLEAN - _SPOILT), 0.0, 1.0))

    def _seen(self, number: int, mask: int, confidence: F64, nodes: F64, stamp_ns: int) -> Seen:
        nodes = nodes + (self._centre.off_m, 0.0)
        if self._direction < 0:
            mask = mask >> 3 | (mask & 7) << 3
            confidence = np.roll(confidence, 3)
            nodes = np.roll(nodes, 3, axis=0)
        certain = bool(confidence.min() >= LEAST_CONFIDENCE)
        sure = tuple(float(c) for c in confidence)
        return Seen(number, mask, sure, certain, nodes, stamp_ns)
