"""Joining what passes read into lines of text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from . import table
from .cell_reader import LOOKAHEAD_CELLS
from .cells import Cell, Seen, certain_dots
from .known_cells import KnownCells
from .lines import LineReader
from .orientation import upside_down
from .pass_reader import PassReader
from .reader_settings import BrailleSettings
from .translation import ALL_DOTS, LineCell, line_reader
from .warp import F64, Warp

#: Cells this near to one that is known, in cell pitches, are that one seen again.
_SAME = 0.4
#: Lines nearer to each other than this, in line pitches, have none between them.
_ROOM_BETWEEN = 1.6
#: Cells that are remembered: 3 km of a line.
MOST_CELLS = 500_000
#: In place of what a text leaves out.
CUT = "…"
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
    passes (`line_order`). A sensor that rolls against the reading direction, or over text that is
    upside down, sees a line's end first, so its lines come when the pass is over.
    Cells that an earlier pass has read are left out.
    """

    def __init__(self, settings: BrailleSettings, warp: Warp) -> None:
        self._settings = settings
        self._warp = warp
        self._decoders: list[table.Decoder] = []
        self._columns: list[dict[int, LineCell]] = []
        # Of each line its text, where it was read since a cell came.
        self._texts: dict[int, str] = {}
        self._read_line = line_reader(settings.code)
        reach_m = (_MOST_GAP + 2) * settings.spacing.cell_pitch_m
        self._known = KnownCells(reach_m, MOST_CELLS)
        self._open: list[_OpenLine] = []
        # Cells given before their line was known, which come again with it.
        self._early: set[int] = set()
        self.repeated = 0

    def text(self) -> list[str]:
        """The lines so far, without trailing spaces."""
        return [self._text(line) for line in range(len(self._columns))]

    def newest_lines(self, most: int) -> Iterator[str]:
        """The lines from the last to the first; of a longer one its last `most` cells."""
        for line in reversed(range(len(self._columns))):
            cells = self._columns[line]
            if len(cells) <= most:
                yield self._text(line)
            else:
                end = next(reversed(cells)) + 1
                yield CUT + self._read(self._cells_of(line, end - most, end))

    def lines(self) -> list[list[LineCell]]:
        """The cells of the lines so far; of the first `MOST_CELLS` and more none are left."""
        ends = (max(columns, default=-1) + 1 for columns in self._columns)
        return [self._cells_of(line, 0, end) for line, end in enumerate(ends)]

    def _cells_of(self, line: int, begin: int, end: int) -> list[LineCell]:
        columns, blank = self._columns[line], LineCell(table.SPACE)
        return [columns.get(c, blank) for c in range(begin, end)]

    def _text(self, line: int) -> str:
        if line not in self._texts:
            end = max(self._columns[line], default=-1) + 1
            self._texts[line] = self._read(self._cells_of(line, 0, end))
        return self._texts[line]

    def _read(self, cells: list[LineCell]) -> str:
        return self._read_line(cells).text.rstrip(" ")

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
            ready = [x for x in reader.lines if x.accepted and x not in begun]
            if not ready:
                return
            first = _lowest(ready) if turned else _upper(ready)
            if not over and self._one_above(reader, first, begun):
                return
            self._open.append(_OpenLine(first))

    def _one_above(self, reader: PassReader, line: LineReader, begun: list[LineReader]) -> bool:
        """Whether a line above one, which is to come first, may begin or be accepted yet."""
        spacing = self._settings.spacing
        ahead = (LOOKAHEAD_CELLS + 2) * spacing.cell_pitch_m
        if reader.reach_m < line.start + ahead and reader.room_above(line):
            # Right below one that has begun there is none.
            below = [line.top_at(line.start) - x.top_at(line.start) for x in begun]
            if not any(0 < gap < _ROOM_BETWEEN * spacing.line_pitch_m for gap in below):
                return True
        waiting = [x for x in reader.lines if not x.accepted]
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
            self.repeated += not early and known not in self._early
            self._early -= set() if early else {known}
            line, column = self._known.where(known)
            place.line, place.column = line, column + 1
            return
        known_dots = self._line_cell(seen)
        if place.line is None:
            broken_off = self._broken_off(dots, place.reader.spacing.cell_pitch_m)
            if broken_off is not None:
                place.line, place.column = broken_off
            else:
                place.line = len(self._columns)
                self._columns.append({})
                self._decoders.append(table.Decoder())
                if not self._saw_before(seen, reader):
                    known_dots = replace(known_dots, after_unseen=True)
        character, readable = self._decode(place.line, known_dots)
        cell = Cell(
            seen.stamp_ns,
            place.line,
            place.column,
            seen.mask,
            character if readable and character is not None else "",
            readable,
            position,
            min(seen.dot_confidence),
            seen.dot_confidence,
            dots,
        )
        self._columns[place.line][place.column] = known_dots
        self._texts.pop(place.line, None)
        forgotten = self._known.add(position, place.line, place.column)
        if forgotten is not None:
            self._forget(*forgotten)
        place.column += 1
        yield cell

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
        if max(self._columns[line]) != last:
            return None
        for between in range(last + 1, column):
            self._columns[line][between] = LineCell(0, 0)
            self._decoders[line].skip(0, 0)
        return line, column

    def _saw_before(self, seen: Seen, reader: PassReader) -> bool:
        """Whether the place of the cell before one, in reading order, was in view."""
        step = seen.dots[3] - seen.dots[0]
        step *= self._settings.spacing.cell_pitch_m / max(float(np.hypot(*step)), 1e-9)
        return reader.saw(seen.dots - step)

    def _line_cell(self, seen: Seen) -> LineCell:
        if seen.certain:
            return LineCell(seen.mask)
        certain = certain_dots(seen.dot_confidence)
        # It is the cell that isn't certain, whatever its dots say one by one.
        return LineCell(seen.mask, certain if certain != ALL_DOTS else 0)

    def _decode(self, line: int, cell: LineCell) -> tuple[str | None, bool]:
        """What a cell stands for by itself in grade 1; whether it can be read in the code."""
        if cell.after_unseen:
            self._decoders[line].skip(0, 0)
        if not cell.readable:
            self._decoders[line].skip(cell.mask, cell.certain)
            return None, False
        character = self._decoders[line].read(cell.mask)
        return character, character is not None or self._settings.code != "grade1"

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
        """Let go of a line's cells up to one: it is too long ago."""
        columns = self._columns[line]
        while columns and (first := next(iter(columns))) <= column:
            del columns[first]
        self._texts.pop(line, None)
        self._early.discard(self._known.count - 1 - MOST_CELLS)


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
