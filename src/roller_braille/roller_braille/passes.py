"""Reading what one pass of the sensor sees: its mosaic, the dots in it, the lines they make up."""

from __future__ import annotations

import numpy as np

from .batches import Batch
from .dots import DotFinder, Dots
from .lattice import Lattice, find_lattice
from .lines import LineReader
from .recognise import Recogniser
from .rolling import Pass
from .settings import BrailleSettings
from .strip import Strip
from .warp import Warp


class PassReader:
    """Reads one pass.

    Parameters
    ----------
    settings : BrailleSettings
        See there.
    warp : Warp
        Motion compensation.
    roll : Pass
        The pass.
    """

    def __init__(self, settings: BrailleSettings, warp: Warp, roll: Pass) -> None:
        self._settings = settings
        self._warp = warp
        self.roll = roll
        self.strip = Strip(settings, warp.half_height_m)
        self._finder = DotFinder(settings)
        self._recogniser = Recogniser(settings)
        self._searched: int | None = None
        self._loose = Dots.none()
        #: Lines in the order they were begun, those given up left out.
        self.lines: list[LineReader] = []
        self.dots = 0
        reach = settings.spacing.dot_diameter_m / 2
        self._view = (-warp.half_height_m + reach, warp.half_height_m - reach)

    def add(self, batch: Batch) -> None:
        """Take a frame of events.

        Raises
        ------
        PoseError
            If poses are missing.
        """
        knots = self._warp.knots(self.roll, batch.start_ns, batch.end_ns)
        self.strip.add(batch.events, self._warp.table, knots)

    def advance(self, final: bool = False) -> None:
        """Read what has left the view; all that was seen if the pass is over."""
        first, end = self.strip.seen
        if end == first:
            return
        complete = end if final else self.strip.complete
        if self._searched is None:
            self._searched = first
        # Searching has a fixed cost: go on in steps of a cell.
        upto = complete + self._finder.margin if final else complete - self._finder.margin
        step = int(self._settings.spacing.cell_pitch_m / self.strip.px_m)
        if not final and upto - self._searched < step:
            return
        found = self._finder.find(self.strip, self._searched, upto)
        self.dots += len(found)
        self._searched = max(self._searched, upto)
        self._share(found)
        self._begin_lines(upto, final)
        for line in self.lines:
            line.advance(min(upto, complete), final)
        self.lines = [line for line in self.lines if line.accepted or not line.closed]
        self.strip.forget_before(self._needed())

    def _share(self, dots: Dots) -> None:
        """Give dots to the lines they belong to; keep those of none."""
        for line in self.lines:
            if not line.closed and len(dots):
                mine = line.holds(dots)
                line.take(dots.where(mine))
                dots = dots.where(~mine)
        self._loose = self._loose.joined(dots)

    def _begin_lines(self, upto: int, final: bool) -> None:
        s = self._settings
        ahead = (s.lookahead_cells + 1) * s.spacing.cell_pitch_m
        while len(self._loose):
            start = float(self._loose.along[0])
            if not final and start + ahead > upto * self.strip.px_m:
                return
            window = self._loose.where(self._loose.along < start + ahead)
            line = self._try(window)
            if line is None:
                # Nothing begins here; give up what is within a cell and go on.
                keep = self._loose.along > start + s.spacing.dot_pitch_m / 2
                self._loose = self._loose.where(keep)
                continue
            self.lines.append(line)
            mine = line.holds(self._loose)
            line.take(self._loose.where(mine))
            self._loose = self._loose.where(~mine)

    def _try(self, dots: Dots) -> LineReader | None:
        """A line through the first of dots, if it can be one."""
        s = self._settings
        lattice = find_lattice(dots, s.spacing, s.pitch_tolerance, self.roll.direction > 0)
        if lattice is None:
            return None
        on, index = lattice.assign(dots)
        if int(on.sum()) < s.min_line_dots or not self._whole(lattice, index[on, 2]):
            return None
        return LineReader(s, self.strip, self._recogniser, lattice, self.roll.direction, self._view)

    def _whole(self, lattice: Lattice, rows: np.ndarray) -> bool:
        """Whether no row of the line can lie outside the view."""
        above = lattice.down - lattice.dot_down >= -self._warp.half_height_m
        return bool(above or set(rows.tolist()) >= {0, 1, 2})

    def _needed(self) -> int:
        """First column that is still needed."""
        px = self.strip.px_m
        margin = self._finder.margin + self._recogniser.margin
        assert self._searched is not None
        needed = [self._searched]
        needed += [int(x.begin / px) for x in self.lines if not x.closed]
        if len(self._loose):
            needed.append(int(self._loose.along[0] / px))
        return min(needed) - margin - 32
