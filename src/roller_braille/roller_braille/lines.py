"""Following one line of Braille along the roll."""

from __future__ import annotations

from enum import Enum

import numpy as np

from .cells import Seen
from .dots import Dots
from .lattice import REACH, Lattice
from .recognise import Energies, Recogniser, Reference, image_around
from .settings import BrailleSettings
from .strip import Kind, Strip
from .warp import F32, F64

#: Cells around one whose dots tell what a dot looks like there, and the least number of dots.
_NEAR_CELLS = 4
_LEAST_DOTS = 4
#: A side of a dot is taken to hold at least this share of its events.
_LEAST_SHARE = 0.2
#: Cells behind whose dots hold the lattice.
_FIT_CELLS = 12
#: A tile with less than this, in a dot's events, is blank.
_BLANK = 1.0
#: A dot may lie this far off its node, along and down.
_MOST_SHIFT_M = 0.00015
#: Cells of other relief in a row that end a line.
_FOREIGN = 2


class _Kind(Enum):
    BLANK = 0
    READ = 1
    FOREIGN = 2


class LineReader:
    """One line: its lattice follows the dots, its cells are read as they leave the view.

    Parameters
    ----------
    settings : BrailleSettings
        See there.
    strip : Strip
        The pass's mosaic.
    recogniser : Recogniser
        Reads cells.
    lattice : Lattice
        Of the line's first cells; cell 0 is its first.
    kind : Kind
        Events that it is read from.
    direction : int
        +1 when the sensor rolls along the camera's x axis, -1 against it.
    view : tuple of float
        First and last way down the image that is fully seen, metres.
    """

    def __init__(
        self,
        settings: BrailleSettings,
        strip: Strip,
        recogniser: Recogniser,
        lattice: Lattice,
        kind: Kind,
        direction: int,
        view: tuple[float, float],
    ) -> None:
        self._settings, self._strip, self._recogniser = settings, strip, recogniser
        self._spacing = settings.spacing
        self.kind = kind
        #: Lattice whose cell 0 is the next to be read.
        self.lattice = lattice
        self._next = 0
        self._left_first = direction > 0
        self._view = view
        self._dots = Dots.none()
        self._sides: F64 = np.empty((0, 4))
        self._pending: list[Seen] = []
        self._unusual = 0
        self._raised = self._circles = 0
        #: Cells read and confirmed, in travel order.
        self.cells: list[Seen] = []
        #: Whether so many of its dots were read that it is a line of Braille.
        self.accepted = False
        #: Whether nothing more will be read.
        self.closed = False

    @property
    def top(self) -> float:
        """Way down the image of the top row, metres."""
        return self.lattice.down

    @property
    def begin(self) -> float:
        """Travel at which the next cell's tile begins, metres."""
        return self.lattice.centre(0)[0] - self.lattice.cell / 2

    @property
    def band(self) -> tuple[float, float]:
        """Way down the image of the line's upper and lower border, metres."""
        half = (self._spacing.line_pitch_m - 2 * self._spacing.dot_pitch_m) / 2
        return self.top - half, self.top + 2 * self.lattice.dot_down + half

    def holds(self, dots: Dots) -> np.ndarray:
        """Which dots lie in the line's band, shape (n,)."""
        down = (
            dots.down - self.lattice.down - self.lattice.slope * (dots.along - self.lattice.along)
        )
        half = (self._spacing.line_pitch_m - 2 * self._spacing.dot_pitch_m) / 2
        return np.asarray((down > -half) & (down < 2 * self.lattice.dot_down + half))

    def take(self, dots: Dots) -> None:
        """Take newly found dots of its band."""
        on, _ = self.lattice.assign(dots)
        dots = dots.where(on)
        if not len(dots):
            return
        image, at = image_around(
            self._strip, np.stack([dots.along, dots.down], -1), self._recogniser.margin, self.kind
        )
        sides = self._recogniser.halves(image, at, self._strip.background(self.kind))
        self._dots = Dots(
            np.append(self._dots.along, dots.along),
            np.append(self._dots.down, dots.down),
            np.append(self._dots.votes, dots.votes),
        )
        self._sides = np.concatenate([self._sides, sides])

    def advance(self, complete: int) -> None:
        """Read the cells whose tiles lie before a column."""
        while not self.closed:
            end = self.lattice.centre(0)[0] + self.lattice.cell / 2
            if int(np.ceil(end / self._strip.px_m)) > complete:
                break
            self._read_next()

    def close(self) -> None:
        """Read no further."""
        self._pending = []
        self.closed = True

    def _read_next(self) -> None:
        kind, seen = self._read()
        if kind is _Kind.READ:
            if seen.certain:
                self._raised += seen.mask.bit_count()
            self.cells += [*self._pending, seen]
            self._pending = []
            self._unusual = 0
            enough = self._raised >= self._settings.min_line_dots
            self.accepted |= enough and 2 * self._circles >= self._raised
        elif self.cells or kind is _Kind.FOREIGN or self._next > self._settings.lookahead_cells:
            self._pending.append(seen)
            self._unusual = self._unusual + 1 if kind is _Kind.FOREIGN else 0
            too_many = len(self._pending) > self._settings.max_spaces
            if too_many or self._unusual > (_FOREIGN if self.accepted else 0):
                self.close()
        self._follow()

    def _follow(self) -> None:
        """Fit the lattice to the dots up to here and step to the next cell."""
        recent = self._dots.along > self.lattice.along - _FIT_CELLS * self.lattice.cell
        self._dots, self._sides = self._dots.where(recent), self._sides[recent]
        near = self._dots.along < self.lattice.along + 2 * self.lattice.cell
        self.lattice = self.lattice.fitted(self._dots.where(near), self._spacing).moved(1)
        self._next += 1

    def _shift(self, lattice: Lattice) -> F64:
        """How far the dots of cell 0 lie off their nodes, (along, down), metres."""
        on, index = lattice.assign(self._dots)
        here = on & (index[:, 0] == 0)
        if not here.any():
            return np.zeros(2)
        nodes = lattice.nodes(0)[index[here, 1] * 3 + index[here, 2]]
        off = np.stack([self._dots.along[here], self._dots.down[here]], -1) - nodes
        # One more dot that lies on its node, so that a single one is not all.
        return np.asarray(off.sum(axis=0) / (len(off) + 1))

    def _own_shifts(self, nodes: F64) -> F64:
        """How far dots found at nodes lie off them, by no more than a little, shape (6, 2)."""
        out = np.zeros_like(nodes)
        for i, node in enumerate(nodes):
            off = np.stack([self._dots.along, self._dots.down], -1) - node
            away = np.hypot(off[:, 0], off[:, 1])
            if len(away) and away.min() < REACH * self._spacing.dot_pitch_m:
                out[i] = off[int(np.argmin(away))]
        return np.clip(out, -_MOST_SHIFT_M, _MOST_SHIFT_M)

    def _reference(self) -> Reference | None:
        cells = np.abs((self._dots.along - self.lattice.centre(0)[0]) / self.lattice.cell)
        near = cells <= _NEAR_CELLS
        if near.sum() < _LEAST_DOTS:
            sides = self._sides[np.argsort(cells, kind="stable")[:_LEAST_DOTS]]
        else:
            sides = self._sides[near]
        if not len(sides):
            return None
        wholes = sides[:, :2].sum(axis=1)
        whole = float(np.median(wholes))
        if whole <= 0:
            return None
        shares = np.median(sides / np.maximum(wholes, 1e-9)[:, None], axis=0)
        return Reference(whole, np.maximum(shares, _LEAST_SHARE))

    def explained(self) -> float:
        """Share of events that its first dots hold, over as many cells as it takes to accept it."""
        reference = self._reference()
        if reference is None:
            return 0.0
        held = total = 0.0
        dots = 0
        for n in range(self._settings.lookahead_cells + 1):
            found = self._measure(self.lattice.moved(n))[3]
            filled = found.whole > reference.whole / 2
            dots += int(filled.sum())
            held += float(found.whole[filled].sum())
            total += max(found.total, 0.0)
            if dots >= self._settings.min_line_dots:
                return held / max(total, 1e-9)
        return 0.0

    def _measure(self, lattice: Lattice) -> tuple[F64, F32, F64, Energies]:
        """Cell 0 of a lattice: its nodes, the image around, their place in it, their events."""
        strip, s = self._strip, self._spacing
        nodes = lattice.nodes(0) + self._shift(lattice)
        image, at = image_around(strip, nodes, self._recogniser.margin, self.kind)
        # Tile: half way to the neighbours; its place in the cut out image.
        offset = at[0] - [nodes[0, 0] / strip.px_m, strip.row(nodes[0, 1])]
        middle, down = lattice.centre(0)
        half = s.line_pitch_m / 2 * lattice.dot_down / s.dot_pitch_m
        a, b = ((middle + side * lattice.cell / 2) / strip.px_m + offset[0] for side in (-1, 1))
        top, bottom = (strip.row(down + side * half) + offset[1] for side in (-1, 1))
        at = at + self._own_shifts(nodes) / strip.px_m
        tile = (round(a), round(b), round(top), round(bottom))
        return (
            nodes,
            image,
            at,
            self._recogniser.measure(image, at, tile, strip.background(self.kind)),
        )

    def _read(self) -> tuple[_Kind, Seen]:
        nodes, image, at, energies = self._measure(self.lattice)
        px = self._strip.px_m
        stamp = self._strip.newest_ns(
            int(self.begin / px), int((self.begin + self.lattice.cell) / px)
        )
        reference = self._reference()
        if reference is None:
            return _Kind.FOREIGN, self._seen(0, np.zeros(6), nodes, stamp)
        reading = self._recogniser.read(image, at, energies, reference)
        self._circles += reading.circles
        outside = (nodes[:, 1] < self._view[0]) | (nodes[:, 1] > self._view[1])
        confidence = np.where(outside, 0.0, reading.confidence)
        mask = int((reading.raised << np.arange(6)).sum())
        if not reading.raised.any() and reading.filled < _BLANK:
            return _Kind.BLANK, self._seen(0, confidence, nodes, stamp)
        if reading.explained < self._settings.min_explained:
            return _Kind.FOREIGN, self._seen(mask, confidence, nodes, stamp)
        return _Kind.READ, self._seen(mask, confidence, nodes, stamp)

    def _seen(self, mask: int, confidence: F64, nodes: F64, stamp_ns: int) -> Seen:
        if not self._left_first:
            mask = mask >> 3 | (mask & 7) << 3
            confidence = np.roll(confidence, 3)
            nodes = np.roll(nodes, 3, axis=0)
        return Seen(
            self._next,
            mask,
            tuple(float(c) for c in confidence),
            bool(confidence.min() >= self._settings.min_dot_confidence),
            nodes,
            stamp_ns,
        )
