"""From a line of cells to print, and which cell each character comes from.

Grade 1 is read by our own table. Unified English Braille, uncontracted or contracted, is read by
liblouis where it is installed (Debian: python3-louis). What a contraction means hangs on its
whole word, so a word with a cell that isn't certain is not read: it stands there as its patterns.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Self

from roller_core.errors import RollerError

from . import table

ALL_DOTS = 0b111111
#: liblouis' tables by the names of the setting `code`.
_TABLES = {"ueb1": "en-ueb-g1.ctb", "ueb2": "en-ueb-g2.ctb"}
#: Where Debian keeps a module that an environment of its own doesn't see.
_SYSTEM = Path("/usr/lib/python3/dist-packages/louis/__init__.py")
#: What liblouis writes for a cell without a meaning.
_UNDEFINED = re.compile(r"\\\d+/")


class TranslationError(RollerError):
    """A code that can't be read on this machine."""


@dataclass(frozen=True, slots=True)
class LineCell:
    """A cell of a line: raised dots as far as seen, and which dots are certain, as masks.

    `after_unseen`: there may be cells before it that weren't in view.
    """

    mask: int
    certain: int = ALL_DOTS
    after_unseen: bool = False

    @property
    def readable(self) -> bool:
        """Whether every dot is certain."""
        return self.certain == ALL_DOTS

    @property
    def shown(self) -> str:
        """How it stands in a text that doesn't know what it means."""
        return table.pattern(self.mask) if self.readable else table.UNREADABLE


class TextLine(tuple[LineCell, ...]):
    """The cells of a line.

    Attributes
    ----------
    number : int
        Number of the line: that which its cells were given with.
    """

    number: int

    def __new__(cls, cells: Iterable[LineCell], number: int) -> Self:
        """A line of cells with its number."""
        line = super().__new__(cls, cells)
        line.number = number
        return line


@dataclass(frozen=True)
class Reading:
    """Print of a line."""

    #: Characters; a cell that isn't certain stands there as U+FFFD, one without a meaning as its
    #: Braille pattern.
    text: str
    #: For each character the cell that it comes from, the first of several.
    cells: tuple[int, ...]


def line_reader(code: str) -> Callable[[Sequence[LineCell]], Reading]:
    """What reads lines of a code.

    Parameters
    ----------
    code : str
        `grade1`, `ueb1` or `ueb2`.

    Raises
    ------
    TranslationError
        If liblouis, which the code needs, isn't there.
    """
    if code == "grade1":
        return _read_grade_1
    louis, name = _liblouis(), _TABLES[code]
    return lambda cells: _read_by_words(cells, louis, name)


def _read_grade_1(cells: Sequence[LineCell]) -> Reading:
    decoder = table.Decoder()
    parts: list[str] = []
    for cell in cells:
        if cell.after_unseen:
            decoder.skip(0, 0)
        if not cell.readable:
            decoder.skip(cell.mask, cell.certain)
            parts.append(cell.shown)
            continue
        found = decoder.read(cell.mask)
        parts.append(cell.shown if found is None else found)
    origin = [k for k, part in enumerate(parts) for _ in part]
    return Reading("".join(parts), tuple(origin))


def _read_by_words(cells: Sequence[LineCell], louis: ModuleType, name: str) -> Reading:
    """Runs of words that are certain by liblouis; others as they look."""
    text, origin = [], []
    for first, last, certain in _runs(cells):
        if certain:
            pattern = "".join(table.pattern(c.mask) for c in cells[first:last])
            part, places = _back_translate(louis, name, pattern)
        else:
            part = "".join(c.shown for c in cells[first:last])
            places = list(range(last - first))
        text.append(part)
        origin += [first + k for k in places]
    return Reading("".join(text), tuple(origin))


def _runs(cells: Sequence[LineCell]) -> list[tuple[int, int, bool]]:
    """Words with an uncertain cell, and what lies between them: first, last + 1, certain."""
    runs: list[tuple[int, int, bool]] = []
    begin = 0
    while begin < len(cells):
        end = begin
        while end < len(cells) and (cells[end].mask != table.SPACE or not cells[end].readable):
            end += 1
        certain = all(c.readable and not c.after_unseen for c in cells[begin:end])
        # The space behind a word belongs to what is certain.
        if runs and runs[-1][2] and certain:
            runs[-1] = (runs[-1][0], end, True)
        elif end > begin:
            runs.append((begin, end, certain))
        if end < len(cells):
            if runs and runs[-1][2]:
                runs[-1] = (runs[-1][0], end + 1, True)
            else:
                runs.append((end, end + 1, True))
        begin = end + 1
    return runs


def _back_translate(louis: ModuleType, name: str, pattern: str) -> tuple[str, list[int]]:
    """Print of certain cells and the cell of each character."""
    try:
        raw, places, _, _ = louis.backTranslate(["unicode.dis", name], pattern)
    except RuntimeError:
        return pattern, list(range(len(pattern)))
    text, origin, done = "", [], 0
    for undefined in _UNDEFINED.finditer(raw):
        cell = places[undefined.start()]
        text += raw[done : undefined.start()] + pattern[cell]
        origin += [*places[done : undefined.start()], cell]
        done = undefined.end()
    return text + raw[done:], [*origin, *places[done : len(raw)]]


@lru_cache(maxsize=1)
def _liblouis() -> ModuleType:
    try:
        return importlib.import_module("louis")
    except ImportError:
        pass
    try:
        spec = importlib.util.spec_from_file_location("louis", _SYSTEM)
        if spec is None or spec.loader is None:
            raise ImportError(str(_SYSTEM))
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except (OSError, ImportError) as error:
        raise TranslationError(
            "codes ueb1 and ueb2 need liblouis: install the Debian package python3-louis, or set "
            "code to grade1"
        ) from error
    return module
