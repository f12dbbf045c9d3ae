"""Lines of text as they are read: their cells by column, and what these stand for."""

from __future__ import annotations

from collections.abc import Sequence

from . import table
from .translation import LineCell, TextLine, line_reader

#: In place of what a text leaves out.
CUT = "…"
_BLANK, _UNREAD = LineCell(table.SPACE), LineCell(0, 0)


class TextLines:
    """The cells of lines; a cell may be put in the place of one that could not be read.

    Parameters
    ----------
    code : str
        The setting `code`.
    """

    def __init__(self, code: str) -> None:
        self._grade_1 = code == "grade1"
        self._read_line = line_reader(code)
        self._columns: list[dict[int, LineCell]] = []
        # What reads the next cell of each line, in grade 1.
        self._decoders: list[table.Decoder] = []
        # Of each line its text, where it was read since a cell came.
        self._texts: dict[int, str] = {}

    def begin(self) -> int:
        """Begin a line: its number."""
        self._columns.append({})
        self._decoders.append(table.Decoder())
        return len(self._columns) - 1

    def last(self, line: int) -> int:
        """The last column of a line; -1 where it has none."""
        return next(reversed(self._columns[line]), -1)

    def at(self, line: int, column: int) -> LineCell:
        """The cell of a line at a column; blank where none was put or it is forgotten."""
        return self._columns[line].get(column, _BLANK)

    def put(self, line: int, column: int, cell: LineCell) -> tuple[str | None, bool]:
        """Put a cell at the end of a line, or in the place of one that could not be read.

        Returns
        -------
        tuple
            What it stands for by itself in grade 1, None if nothing that is certain; whether it can
            be read in the code.
        """
        at_end = column > self.last(line)
        decoder = self._decoders[line] if at_end else self._decoder_before(line, column)
        self._columns[line][column] = cell
        self._texts.pop(line, None)
        found = _decode(decoder, cell)
        if not at_end:
            self._decoders[line] = self._decoder_before(line, self.last(line) + 1)
        return found, cell.readable and (found is not None or not self._grade_1)

    def meanings(self, line: int, column: int) -> dict[int, str | None]:
        """By column what cells stand for in grade 1, from one on up to the next space."""
        found, decoder = {}, self._decoder_before(line, column)
        while column in self._columns[line] and (cell := self.at(line, column)) != _BLANK:
            found[column] = _decode(decoder, cell)
            column += 1
        return found

    def leave_unread(self, line: int, column: int) -> None:
        """Go on with a line at a column; the cells before it that it lacks can't be read."""
        for between in range(self.last(line) + 1, column):
            self.put(line, between, _UNREAD)

    def forget(self, line: int, column: int) -> None:
        """Let go of a line's cells up to one: it is too long ago."""
        columns = self._columns[line]
        while columns and (first := next(iter(columns))) <= column:
            del columns[first]
        self._texts.pop(line, None)

    def text(self, line: int) -> str:
        """A line so far, without trailing spaces."""
        if line not in self._texts:
            self._texts[line] = self._read(self.cells(line))
        return self._texts[line]

    def newest(self, line: int, most: int) -> str:
        """The same; of a longer one its last `most` cells."""
        if len(self._columns[line]) <= most:
            return self.text(line)
        end = self.last(line) + 1
        return CUT + self._read(self._cells(line, end - most, end))

    def cells(self, line: int) -> TextLine:
        """The cells of a line so far, blank where they are forgotten."""
        return TextLine(self._cells(line, 0, self.last(line) + 1), line)

    def _decoder_before(self, line: int, column: int) -> table.Decoder:
        """What reads a line's cell at a column: with a space before it all begins anew."""
        first = column
        while first - 1 in self._columns[line] and self.at(line, first - 1) != _BLANK:
            first -= 1
        decoder = table.Decoder()
        for cell in self._cells(line, first, column):
            _decode(decoder, cell)
        return decoder

    def _cells(self, line: int, begin: int, end: int) -> list[LineCell]:
        return [self.at(line, column) for column in range(begin, end)]

    def _read(self, cells: Sequence[LineCell]) -> str:
        return self._read_line(cells).text.rstrip(" ")


def _decode(decoder: table.Decoder, cell: LineCell) -> str | None:
    """What a cell stands for by itself in grade 1."""
    if cell.after_unseen:
        decoder.skip(0, 0)
    if cell.readable:
        return decoder.read(cell.mask)
    decoder.skip(cell.mask, cell.certain)
    return None
