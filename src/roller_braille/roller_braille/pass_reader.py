"""Reading what one pass of the sensor sees: its mosaic, the dots in it, the lines they make up."""

from __future__ import annotations

import numpy as np

from roller_core.passes import Pass

from .batches import Batch
from .cell_reader import LOOKAHEAD_CELLS
from .contrast import MappedBatch, TravelScale
from .dots import DotFinder, Dots
from .kinds import Kind
from .lattice_search import FAINT, LEAST_LINE_PITCH, least_votes
from .line_finder import LineFinder
from .lines import LineReader
from .orientation import LIKELY, MOST_CELLS, SURE, log_odds
from .previews import Preview, Previewer
from .reader_settings import BrailleSettings
from .recognise import Recogniser
from .strip import Strip
from .warp import F32, F64, Warp

#: Where no line begins, dots so many times as strong stay. Tuned on the virtual cell.
_STRONGER = 3.0
#: Cells of travel, and seconds, after which lines are read on.
_STEP, _STEP_S = 0.25, 0.012
#: Share of what two dots ahead have below which a spot is an outlier in any case. Tuned on the
#: virtual cell.
_OUTLIER = 0.02


def _at(dots: Dots, start: float) -> bool:
    return bool(len(dots)) and float(dots.along[0]) == start


class PassReader:
    """Reads one pass."""

    def __init__(self, settings: BrailleSettings, warp: Warp, roll: Pass) -> None:
        self._settings = settings
        self._warp = warp
        self.roll = roll
        self.strip = Strip(settings, warp.half_height_m)
        #: Scale of the poses' travel; the strip and all that is found in it are in the events'.
        self.travel = TravelScale(settings)
        self._table = warp.table
        self._finder = DotFinder(settings.spacing)
        self._recogniser = Recogniser(settings.spacing)
        self._searched: int | None = None
        self._looked_s = 0.0
        self._kinds = (
            (Kind.OFF, Kind.ON) if settings.polarity == "auto" else (Kind(settings.polarity),)
        )
        self._loose = {kind: Dots.none() for kind in self._kinds}
        #: Lines in the order they were begun, those given up left out.
        self.lines: list[LineReader] = []
        self._previewer = Previewer(settings, self.strip, self._finder)
        #: Beginnings of lines that aren't known for lines yet, from the top.
        self.previews: list[Preview] = []
        self.dots = 0
        #: Whether its text is upside down; None while that is open.
        self.upside_down: bool | None = None
        #: Events of a dot where a line was last read.
        self._typical = 0.0
        #: Place up to which lines were read, metres.
        self.reach_m = -np.inf
        self._line_finder = LineFinder(
            settings, self.strip, self._recogniser, roll.direction, warp.half_height_m
        )

    def add(self, batch: Batch, table: F32) -> None:
        """Take a batch of events; `table` holds the pixels to use, see `vote`.

        Raises
        ------
        PoseError
            If poses are missing.
        """
        knots = self._warp.knots(self.roll, batch.start_ns, batch.end_ns)
        self._table = table
        self._count(self.travel.add(MappedBatch(batch.events, knots), table))

    def _count(self, batches: list[MappedBatch]) -> None:
        for batch in batches:
            self.strip.add(batch.events, self._table, batch.knots)

    def advance(self, final: bool = False) -> None:
        """Read what was seen for long enough; all that was seen if the pass is over."""
        if final:
            self._count(self.travel.release())
        first, end = self.strip.exposure.seen
        if end == first:
            return
        complete = end if final else self.strip.exposure.complete
        if self._searched is None:
            self._searched = first
        # Searching has a fixed cost: go on in steps.
        upto = complete + self._finder.margin if final else complete - self._finder.margin
        step = int(_STEP * self._settings.spacing.cell_pitch_m / self.strip.px_m)
        rolled_s = self.strip.exposure.rolled_s
        if not final and (upto - self._searched < step or rolled_s - self._looked_s < _STEP_S):
            return
        self._looked_s = rolled_s
        settled = any(line.accepted for line in self.lines)
        if self._finder.look_at_coating(self.strip, self._searched, upto, settled):
            # What was found so far was found in other images.
            self.lines, self._loose = [], {kind: Dots.none() for kind in self._kinds}
            self._searched = max(first, self.strip.first)
        for kind in self._kinds:
            found = self._finder.find(self.strip, self._searched, upto, kind)
            self.dots += len(found)
            self._share(found, kind)
        self._searched = max(self._searched, upto)
        reach = min(upto, complete)
        self.reach_m = reach * self.strip.px_m
        for line in self.lines:
            self._advance(line, reach, final)
        self._begin_lines(reach, final)
        if final:
            for line in self.lines:
                line.close()
            self._loose = {kind: Dots.none() for kind in self._kinds}
        self.lines = [line for line in self.lines if line.accepted or not line.closed]
        self._judge_orientation(LIKELY if final else SURE)
        self.previews = [] if final else self._preview(upto)
        self.strip.forget_before(self._needed())
        starts = [line.start for line in self.lines] + [p.line.start for p in self.previews]
        self.travel.forget_before(min([*starts, self.strip.first * self.strip.px_m]))

    def saw(self, places: F64) -> bool:
        """Whether all of some places, travel and place down the image in metres, were in view."""
        top, bottom = self._line_finder.view
        inside = (places[:, 1] >= top) & (places[:, 1] <= bottom)
        return bool((inside & self.strip.exposure.shown(places[:, 0])).all())

    def room_above(self, line: LineReader) -> bool:
        """Whether the view could hold another line above one."""
        top = line.top_at(line.start) - LEAST_LINE_PITCH * self._settings.spacing.line_pitch_m
        return top >= -self._warp.half_height_m

    def _judge_orientation(self, sure: float) -> None:
        """Tell from the cells read so far whether text is upside down; left as is if in doubt."""
        if self.upside_down is not None:
            return
        lines = [line.cells for line in self.lines if line.accepted]
        odds = sum(log_odds(cells, self._settings.code) for cells in lines)
        count = sum(seen.certain and seen.mask > 0 for cells in lines for seen in cells)
        if abs(odds) >= sure:
            self.upside_down = odds < 0
        elif count >= MOST_CELLS:
            self.upside_down = False
        for line in self.lines:
            line.may_be_turned = self.upside_down is not False

    def _preview(self, upto: int) -> list[Preview]:
        """Lines that can't be begun yet, if it is sure that they are upright."""
        if self.roll.direction < 0 or self.upside_down:
            return []
        known = {kind: self._free(loose) for kind, loose in self._loose.items()}
        found = self._previewer.look(known, upto, self._free, self._line_finder.best)
        if any(self._near(p.line, x) for p in found for x in self.lines if not x.accepted):
            return []  # one on trial may yet turn out to be the beginning of it
        if found and self.upside_down is None:
            lines = [line for line in self.lines if line.accepted] + [p.line for p in found]
            if sum(log_odds(line.cells, self._settings.code) for line in lines) < SURE:
                return []
            self.upside_down = False
        return found

    def _near(self, one: LineReader, other: LineReader) -> bool:
        """Whether only one of two lines can be one."""
        away = one.top_at(one.start) - other.top_at(one.start)
        return abs(away) < LEAST_LINE_PITCH * self._settings.spacing.line_pitch_m

    def _share(self, dots: Dots, kind: Kind) -> None:
        """Give dots to the lines they may belong to; they stay at hand till that is known."""
        for line in self.lines:
            if not line.closed and line.kind is kind:
                line.take(dots.where(line.holds(dots)))
        self._loose[kind] = self._loose[kind].joined(dots)

    def _advance(self, line: LineReader, complete: int, final: bool) -> None:
        """Read a line on and forget the dots that are its own, or nobody's."""
        if line.closed:
            return
        line.advance(complete, final)
        if line.accepted:
            self._typical = line.typical
            self._line_finder.turn, self._line_finder.spacing = line.lattice.angle, line.spacing
            if line.closed:
                self._line_finder.end(line)
        for kind, loose in self._loose.items():
            if kind is not line.kind and line.closed and not line.accepted:
                continue  # a line in vain of one kind leaves those of the other
            own = line.holds(loose) & (loose.along < line.confirmed)
            if line.closed and not line.accepted:
                self._line_finder.pass_over(kind, loose.where(own))
            self._loose[kind] = loose.where(~own)

    def _begin_lines(self, upto: int, final: bool) -> None:
        s = self._settings
        ahead = (LOOKAHEAD_CELLS + 1) * s.spacing.cell_pitch_m
        # Where lines would have begun by now, what is an outlier beside those read isn't kept.
        behind = upto * self.strip.px_m - ahead
        for kind, loose in self._loose.items():
            solid = loose.votes >= FAINT * self._typical
            self._loose[kind] = loose.where(solid | (loose.along >= behind))
        while True:
            free = {kind: self._free(loose) for kind, loose in self._loose.items()}
            starts = [float(dots.along[0]) for dots in free.values() if len(dots)]
            if not starts or not (final or min(starts) + ahead <= upto * self.strip.px_m):
                return
            start = min(starts)
            if self._give_up_outliers(free, start, ahead):
                continue
            end = start + ahead
            line = self._line_finder.best(free, start, end)
            if line is None and not (self.strip.printed or self._line_finder.begins_stray):
                # Other relief may come soon after a short text. A printed coating's spots are
                # told from dots by more of these than such a text has.
                end = start + ahead / 2
                line = self._line_finder.best(free, start, end)
            if line is not None:
                self.lines.append(line)
                # It has the dots of the window; these come after.
                loose = free[line.kind]
                line.take(loose.where(line.holds(loose) & (loose.along >= end)))
                self._advance(line, upto, final)
                if line.accepted or not line.closed:
                    continue
                self.lines.remove(line)
            # Where nothing begins, what is within a dot is given up, but for what is far stronger:
            # outliers may lie beside a line's first dots.
            strong = _STRONGER * max(float(d.votes[0]) for d in free.values() if _at(d, start))
            for kind, loose in self._loose.items():
                near = loose.along <= start + s.spacing.dot_pitch_m / 2
                gone = near & (loose.votes <= strong)
                self._line_finder.pass_over(kind, loose.where(gone))
                self._loose[kind] = loose.where(~gone)

    def _give_up_outliers(self, free: dict[Kind, Dots], start: float, ahead_m: float) -> bool:
        """Forget the first dots if they are far weaker than those after them or in lines."""
        near, ahead = (
            np.sort(
                np.concatenate([dots.votes[dots.along < start + reach] for dots in free.values()])
            )
            for reach in (ahead_m / 2, ahead_m)
        )
        least = least_votes(near)
        # Where a line's very first dots come into view, they are fewer than that.
        least = max(least, _OUTLIER * float(ahead[-min(2, len(ahead))]))
        if any(_at(d, start) and float(d.votes[0]) >= least for d in free.values()):
            return False
        for kind, loose in self._loose.items():
            self._loose[kind] = loose.where((loose.along > start) | (loose.votes >= least))
        return True

    def _free(self, dots: Dots) -> Dots:
        """Those dots that no open line has, and that are no outliers beside those of lines."""
        dots = dots.where(dots.votes >= FAINT * self._typical)
        for line in self.lines:
            if not line.closed:
                dots = dots.where(~line.holds(dots))
        return dots

    def _needed(self) -> int:
        """First column that is still needed."""
        px = self.strip.px_m
        margin = self._finder.margin + self._recogniser.margin
        assert self._searched is not None
        loose = [float(d.along[0]) for d in self._loose.values() if len(d)]
        begin = min([self._searched * px, *loose])
        needed = [x.needed_from for x in self.lines if not x.closed]
        first = min([begin, self._line_finder.needed_from(begin), *needed])
        return int(first / px) - margin - 32
