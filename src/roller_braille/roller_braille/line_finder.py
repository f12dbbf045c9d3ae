"""Finding the line of Braille that begins with the first of some dots."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from .cell_reader import LEAST_DOTS, LEAST_EXPLAINED, LOOKAHEAD_CELLS
from .dot_shape import alike
from .dots import Dots
from .kinds import Kind
from .lattice import Lattice
from .lattice_search import LEAST_LINE_PITCH, are_strong, find_lattice, find_turn
from .line_begin import REACH_CELLS
from .lines import LineReader
from .reader_settings import BrailleSettings, Spacing
from .recognise import ASTRAY_M, Recogniser
from .strip import Strip

#: Angles nearer to each other than this are one, radians.
_SAME_TURN = 0.03
#: Cells of a line on trial whose dots have to lie on nodes, and how well at the mean: of spots that
#: lie anywhere a fifth does, of a line's nine tenths, of one between other relief a third.
_FIRST_CELLS, _IN_PLACE = 3, 0.25
#: Dots beyond its first by which it is known where a line's lattice lies, and how well they lie on
#: it at the mean.
_TELLING_DOTS, _ON_NODES = 4, 0.8
#: Lines that ended which are remembered: more than are in view together.
_MOST_ENDED = 8


class LineFinder:
    """Finds lines of a pass.

    Parameters
    ----------
    settings : BrailleSettings
        Spacings that a line may have.
    strip : Strip
        The pass's mosaic.
    recogniser : Recogniser
        Reads cells.
    direction : int
        +1 when the sensor rolls along the camera's x axis, -1 against it.
    half_height_m : float
        Half height of the view.
    """

    def __init__(
        self,
        settings: BrailleSettings,
        strip: Strip,
        recogniser: Recogniser,
        direction: int,
        half_height_m: float,
    ) -> None:
        self._settings, self._strip, self._recogniser = settings, strip, recogniser
        self._direction, self._half_height_m = direction, half_height_m
        reach = settings.spacing.dot_diameter_m / 2
        #: First and last place down the image that is fully seen, metres.
        self.view = -half_height_m + reach, half_height_m - reach
        #: Turn and spacing of the plate where a line was last read; None before.
        self.turn: float | None = None
        self.spacing: Spacing | None = None
        #: Whether what `best` was last given begins with a spot that is no dot of the line after.
        self.begins_stray = False
        # Dots with which no line began, though one that begins soon after may have had them.
        self._passed_over: dict[Kind, Dots] = {}
        # Lines that ended, and the travel up to which they have what lies in their band, metres.
        self._ended: deque[tuple[LineReader, float]] = deque(maxlen=_MOST_ENDED)

    def pass_over(self, kind: Kind, dots: Dots) -> None:
        """Remember dots with which no line began by themselves."""
        self._passed_over[kind] = self._passed_over.get(kind, Dots.none()).joined(dots)

    def needed_from(self, along: float) -> float:
        """Travel from which on the mosaic is needed for lines that begin at a place or later."""
        cell = self._settings.spacing.cell_pitch_m
        if self._strip.printed:
            return along - (REACH_CELLS + 1) * cell
        begin = along - (LOOKAHEAD_CELLS + 2) * cell
        for kind, dots in self._passed_over.items():
            self._passed_over[kind] = recent = dots.where(dots.along >= begin)
            if len(recent):
                along = min(along, float(recent.along[0]) - cell)
        return along

    def best(self, free: dict[Kind, Dots], start: float, end: float) -> LineReader | None:
        """The line from a place to another that explains its events best, of either kind."""
        self.begins_stray = False
        found = [self._try(dots, kind, start, end) for kind, dots in free.items()]
        line = max(found, key=lambda f: f[0])[1]
        if line and self._strip.printed:
            # Of the coating's spots, there are some on any lattice: what is before is looked for
            # when it is known what the line's dots look like.
            line.begins_after_m = self._ended_before(line)
        elif line and (passed_over := self._passed_over.get(line.kind)):
            line.read_back(passed_over)
        return line

    def end(self, line: LineReader) -> None:
        """A line of text ended: what lies in its band up to there is its own."""
        self._ended.append((line, line.confirmed))

    def _ended_before(self, line: LineReader) -> float:
        """Travel up to which another line lies in the band of one, metres."""
        near = LEAST_LINE_PITCH * self._settings.spacing.line_pitch_m
        at = line.start
        ends = [end for x, end in self._ended if abs(x.top_at(at) - line.top_at(at)) < near]
        return max(ends, default=-np.inf)

    def _try(
        self, dots: Dots, kind: Kind, start: float, end: float
    ) -> tuple[float, LineReader | None]:
        """A line that begins with the first of dots, and how well it explains them."""
        dots = dots.where(dots.along < end)
        if len(dots) < LEAST_DOTS:
            return 0.0, None
        solid = dots.where(are_strong(dots.votes))
        if not len(solid) or solid.along[0] > start + self._settings.spacing.dot_pitch_m / 2:
            return 0.0, None  # what the window begins with is an outlier
        if self._strip.printed:
            dots = alike(self._strip, self._settings.spacing, dots)
            if len(dots) < LEAST_DOTS:
                return 0.0, None
        seen = find_turn(dots, self._settings.spacing)
        first = seen if self.turn is None else self.turn
        second = 0.0 if self.turn is None else seen
        found = self._try_turn(dots, kind, start, first)
        if found[1] is None and abs(second - first) > _SAME_TURN:
            found = self._try_turn(dots, kind, start, second)
        if found[1] and self._stray(found[1], dots, start + self._settings.spacing.dot_pitch_m / 2):
            self.begins_stray = True
            return 0.0, None
        return found

    def _try_turn(
        self, dots: Dots, kind: Kind, start: float, turn: float
    ) -> tuple[float, LineReader | None]:
        """The same at an angle."""
        s = self._settings
        solid = dots.where(are_strong(dots.votes))
        left_first = self._direction > 0
        begins_m = start + s.spacing.dot_pitch_m / 2
        fits = [
            (lattice.fit_of(solid), lattice, spacing)
            for spacing in ((self.spacing,) if self.spacing else s.spacings)
            if (lattice := find_lattice(dots, spacing, left_first, turn, begins_m))
        ]
        if not fits:
            return 0.0, None
        _, lattice, spacing = max(fits, key=lambda fit: fit[0])
        # Between two profiles, what its first dots say is nearer than either.
        lattice = lattice.fitted(solid, spacing)
        spacing = replace(spacing, dot_pitch_m=lattice.dot_along, cell_pitch_m=lattice.cell)
        on, index = lattice.assign(dots)
        if not on.any() or dots.along[on].min() > begins_m:
            return 0.0, None  # what the window begins with is none of its dots
        if int(on.sum()) < LEAST_DOTS or not self._whole(lattice, index[on, 2]):
            return 0.0, None
        line = LineReader(
            self._strip, self._recogniser, lattice, spacing, kind, self._direction, self.view
        )
        line.may_be_lower = not self._followed(lattice, solid, spacing)
        first = solid.where(line.holds(solid) & (lattice.assign(solid)[1][:, 0] < _FIRST_CELLS))
        if lattice.fit_of(first) < _IN_PLACE * len(first):
            return 0.0, None
        line.take(dots)
        explained = line.explained()
        if explained < LEAST_EXPLAINED:
            return 0.0, None
        # What lies beside dots, such as their shadows, explains as much but lies beside nodes.
        own = solid.where(line.holds(solid))
        return explained * lattice.fit_of(own) / max(len(own), 1), line

    def _stray(self, line: LineReader, dots: Dots, begins_m: float) -> bool:
        """Whether of dots up to a place none lies on a node of the lattice under those after it.

        Where a line's first dots lie, the others say: laid under these as well, a lattice gives way
        to a spot that is no dot.
        """
        own = dots.where(line.holds(dots) & are_strong(dots.votes))
        first, rest = own.where(own.along <= begins_m), own.where(own.along > begins_m)
        if not len(first) or len(rest) < _TELLING_DOTS:
            return False
        thought = line.lattice
        turn = find_turn(rest, line.spacing) if self.turn is None else self.turn
        found = find_lattice(rest, line.spacing, self._direction > 0, turn)
        if found is None or found.column_fit(rest) < _ON_NODES * len(rest):
            return False
        # The others may leave it open in which column they are.
        sides = [found.shifted(k * found.dot_along, 0.0) for k in (0, -1, 1)]
        at = thought.centre(0)[0]
        aside = [abs(math.remainder(x.centre(0)[0] - at, x.cell)) for x in sides]
        lattice = sides[int(np.argmin(aside))]
        return bool(lattice.column_off(first).min() > ASTRAY_M)

    def _followed(self, lattice: Lattice, dots: Dots, spacing: Spacing) -> bool:
        """Whether a line's rows can lie no lower, for those of the line below would be too near."""
        _, down = lattice.own(dots)
        begin = (spacing.line_pitch_m + 2 * spacing.dot_pitch_m) / 2
        end = LEAST_LINE_PITCH * spacing.line_pitch_m + lattice.dot_down
        return bool(((down > begin) & (down < end)).any())

    def _whole(self, lattice: Lattice, rows: np.ndarray) -> bool:
        """Whether no row of the line can lie outside the view."""
        above = lattice.places(0.0, -lattice.dot_down)[1] >= -self._half_height_m
        return bool(above or set(rows.tolist()) >= {0, 1, 2})
