"""Joining what passes read into lines of text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from .cell_reader import LOOKAHEAD_CELLS
from .cells import Cell, Seen, certain_dots
from .known_cells import KnownCells
from .lines import LineReader
from .orientation import upside_down
from .page_order import PageOrder
from .pass_reader import PassReader
from .reader_settings import BrailleSettings
from .text_lines import CUT, TextLines
from .translation import ALL_DOTS, LineCell, TextLine
from .warp import F64, Warp

#: Cells this near to one that is known, in cell pitches, are that one seen again.
_SAME = 0.4
#: Lines nearer to each other than this, in line pitches, have none between them.
_ROOM_BETWEEN = 1.6
#: Cells by which a line may be indented and still come before the one below, in reading order.
_MOST_INDENT = 4
#: Cells that are remembered: 3 km of a line.
MOST_CELLS = 500_000
#: A line that broke off goes on after this many cells at most, on its lattice to within so many.
_MOST_GAP, _IN_ROW = 6, 0.1


def _upper(lines: Sequence[LineReader]) -> LineReader:
    """The uppermost of lines."""
    at = max(line.start for line in lines)
    return min(lines, key=lambda line: line.top_at(at))


def _lowest(lines: Sequence[LineReader]) -> LineReader:
    """The lowest of lines."""
    at = max(line.start for line in lines)
    return max(lines, key=lambda line: line.top_at(at))


class _OpenLine:
    """A line whose cells are being given: how many were, and where the next one goes."""

    def __init__(self, reader: LineReader) -> None:
        self.reader = reader
        self.given = 0
        self.line: int | None = None
        self.column = 0


class Page:
    """Puts cells in reading order and finds what they stand for.

    Lines that are in view together are given one after the other, from the top, or each as it
    passes (`line_order`). A line keeps the number that it is first given with; its text stands
    where the line lies on the page. A sensor that rolls against the reading direction, or over text
    that is upside down, sees a line's end first, so its lines come when the pass is over.
    Cells that an earlier pass has read are left out; one that it could not read is given again, at
    its line and column, by the pass that reads it.
    """

    def __init__(self, settings: BrailleSettings, warp: Warp) -> None:
        self._settings = settings
        self._warp = warp
        self._lines = TextLines(settings.code)
        self._order = PageOrder(settings.spacing)
        reach_m = (_MOST_GAP + 2) * settings.spacing.cell_pitch_m
        self._known = KnownCells(reach_m, MOST_CELLS)
        self._open: list[_OpenLine] = []
        # Cells given before their line was known, which come again with it.
        self._early: set[int] = set()
        # Line and column of cells to be given again by the next pass that reads them: they could
        # not be read, or stand for something else since one before them was.
        self._doubtful: set[tuple[int, int]] = set()
        #: Cells seen again, and those of them that are given again.
        self.repeated = self.reread = 0

    def text(self) -> list[str]:
        """The lines so far, as they lie on the page, without trailing spaces."""
        return [self._lines.text(line) for line in self._order.lines]

    def newest_lines(self, most: int) -> Iterator[str]:
        """The lines from the last to the first; of a longer one its last `most` cells."""
        return (self._lines.newest(line, most) for line in reversed(self._order.lines))

    def lines(self) -> list[TextLine]:
        """The cells of the lines so far; of the first `MOST_CELLS` and more none are left."""
        return [self._lines.cells(line) for line in self._order.lines]

    def collect(self, reader: PassReader, over: bool) -> Iterator[Cell]:
        """Cells of a pass that can be given now."""
        turned = reader.upside_down
        backwards = (reader.roll.direction < 0) != bool(turned)
        # Where its rows lie in text upside down, a line as a whole tells.
        if not over and (backwards or turned is not False):
            return
        while True:
            self._open_lines(reader, over, bool(turned))
            ended = [line for line in self._open if line.reader.closed]
            for line in self._open:
                cells = line.reader.cells
                if turned:
                    cells = upside_down(cells)
                new = cells[::-1] if backwards else cells[line.given :]
                line.given = len(cells)
                for seen in new:
                    yield from self._give(line, seen, reader)
            if not ended:
                break
            for line in ended:
                self._open.remove(line)
                reader.lines.remove(line.reader)
        if not over:
            yield from self._give_early(reader)

    def _give_early(self, reader: PassReader) -> Iterator[Cell]:
        """First cells of lines that aren't known for lines yet."""
        begun = [line.reader for line in self._open]
        for preview in reader.previews:
            if begun and self._settings.line_order != "seen":
                return
            if self._one_above(reader, preview.line, begun):
                return
            begun.append(preview.line)
            place = _OpenLine(preview.line)
            for seen in preview.cells:
                before = self._known.count
                yield from self._give(place, seen, reader, early=True)
                self._early.update(range(before, self._known.count))

    def _open_lines(self, reader: PassReader, over: bool, turned: bool) -> None:
        """Begin with the lines that it is the turn of."""
        while not self._open or self._settings.line_order == "seen":
            begun = [line.reader for line in self._open]
            ready = [x for x in reader.lines if x.begun and x not in begun]
            if not ready:
                return
            first = _lowest(ready) if turned else _upper(ready)
            if not over and self._one_above(reader, first, begun):
                return
            self._open.append(_OpenLine(first))

    def _one_above(self, reader: PassReader, line: LineReader, begun: list[LineReader]) -> bool:
        """Whether a line above one, which is to come first, may begin or be accepted yet."""
        spacing = self._settings.spacing
        indent = 0 if self._settings.line_order == "seen" else _MOST_INDENT
        ahead = (indent + LOOKAHEAD_CELLS + 2) * spacing.cell_pitch_m
        if reader.reach_m < line.start + ahead and reader.room_above(line):
            # Right below one that has begun there is none.
            below = [line.top_at(line.start) - x.top_at(line.start) for x in begun]
            if not any(0 < gap < _ROOM_BETWEEN * spacing.line_pitch_m for gap in below):
                return True
        waiting = [x for x in reader.lines if not x.begun]
        return any(_upper([x, line]) is x for x in waiting)

    def _give(
        self, place: _OpenLine, seen: Seen, reader: PassReader, early: bool = False
    ) -> Iterator[Cell]:
        depth = self._warp.depth_at(reader.roll)
        along = reader.travel.in_poses_scale(seen.dots[:, 0])
        dots = self._warp.surface_points(reader.roll, along, seen.dots[:, 1], depth)
        position = dots.mean(axis=0)
        known = self._find(position)
        if known is not None:
            first, (line, column) = place.line is None, self._known.where(known)
            place.line, place.column = line, column + 1
            if early:
                return
            self.repeated += known not in self._early
            self._early.discard(known)
            if (line, column) in self._doubtful:
                sees_begin = first and self._saw_before(seen, reader)
                yield from self._give_again(line, column, seen, dots, sees_begin)
            return
        line_cell = _line_cell(seen)
        if place.line is None:
            broken_off = self._broken_off(dots, place.reader.spacing.cell_pitch_m)
            if broken_off is not None:
                place.line, place.column = broken_off
            else:
                place.line = self._lines.begin()
                if not self._saw_before(seen, reader):
                    line_cell = replace(line_cell, after_unseen=True)
        line, column = place.line, place.column
        place.column += 1
        character, readable = self._lines.put(line, column, line_cell)
        if not readable:
            self._doubtful.add((line, column))
        self._order.take(line, dots)
        forgotten = self._known.add(position, line, column)
        if forgotten is not None:
            self._forget(*forgotten)
        yield _cell(seen, line, column, character, readable, dots)

    def _give_again(
        self, line: int, column: int, seen: Seen, dots: F64, sees_begin: bool
    ) -> Iterator[Cell]:
        """A cell that is known but in doubt, if it can be read now.

        `sees_begin`: nothing lies before it in its line, and that was in view.
        """
        was = self._lines.at(line, column)
        # Two passes that are sure of different dots leave it open which of them is right.
        if not seen.certain or (was.mask ^ seen.mask) & was.certain:
            return
        now = LineCell(seen.mask, after_unseen=was.after_unseen and not sees_begin)
        rest = self._lines.meanings(line, column + 1)
        character, readable = self._lines.put(line, column, now)
        for k, meaning in self._lines.meanings(line, column + 1).items():
            if rest.get(k) != meaning:
                self._doubtful.add((line, k))
        if readable:
            self._doubtful.discard((line, column))
        if readable or not was.readable:
            self.reread += 1
            yield _cell(seen, line, column, character, readable, dots)

    def _broken_off(self, dots: F64, pitch_m: float) -> tuple[int, int] | None:
        """Line and column of a cell that continues the row of a line which broke off before it.

        The cells between, other relief perhaps, stand in the line as unreadable.
        """
        numbers, places = self._known.near(dots.mean(axis=0))
        if not numbers:
            return None
        right, down = dots[3] - dots[0], dots[1] - dots[0]
        away = (dots.mean(axis=0) - places) / pitch_m
        along, across = (away @ axis / np.linalg.norm(axis) for axis in (right, down))
        gap = np.round(along)
        in_row = (gap >= 1) & (gap <= _MOST_GAP) & (np.hypot(along - gap, across) < _IN_ROW)
        if not in_row.any():
            return None
        nearest = int(np.argmin(np.where(in_row, gap, np.inf)))
        line, last = self._known.where(numbers[nearest])
        column = last + int(gap[nearest])
        if self._lines.last(line) != last:
            return None
        self._lines.leave_unread(line, column)
        return line, column

    def _saw_before(self, seen: Seen, reader: PassReader) -> bool:
        """Whether the place of the cell before one, in reading order, was in view."""
        step = seen.dots[3] - seen.dots[0]
        step *= self._settings.spacing.cell_pitch_m / max(float(np.hypot(*step)), 1e-9)
        return reader.saw(seen.dots - step)

    def _find(self, position: F64) -> int | None:
        """The known cell at a place."""
        numbers, places = self._known.near(position)
        if not numbers:
            return None
        away = np.linalg.norm(places - position, axis=1)
        nearest = int(np.argmin(away))
        limit = _SAME * self._settings.spacing.cell_pitch_m
        return numbers[nearest] if away[nearest] < limit else None

    def _forget(self, line: int, column: int) -> None:
        self._lines.forget(line, column)
        self._early.discard(self._known.count - 1 - MOST_CELLS)
        self._doubtful.discard((line, column))


def _line_cell(seen: Seen) -> LineCell:
    if seen.certain:
        return LineCell(seen.mask)
    certain = certain_dots(seen.dot_confidence)
    # It is the cell that isn't certain, whatever its dots say one by one.
    return LineCell(seen.mask, certain if certain != ALL_DOTS else 0)


def _cell(
    seen: Seen, line: int, column: int, character: str | None, readable: bool, dots: F64
) -> Cell:
    return Cell(
        seen.stamp_ns,
        line,
        column,
        seen.mask,
        character if readable and character is not None else "",
        readable,
        dots.mean(axis=0),
        min(seen.dot_confidence),
        seen.dot_confidence,
        dots,
    )


def newest_text(lines: Iterable[str], most: int) -> str:
    """The end of a text: lines come from the last to the first; `CUT` stands for what is before."""
    kept: list[str] = []
    left = most
    for line in lines:
        kept.append(line)
        left -= len(line) + 1
        if left < 0:
            break
    text = "\n".join(reversed(kept))
    return text if len(text) <= most else CUT + text[-most:]
