"""How well a text was read: read and true characters aligned by edit distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from roller_braille.table import UNREADABLE


@dataclass(frozen=True)
class Score:
    """What became of the characters of a text."""

    #: True characters, spaces between words included.
    characters: int = 0
    #: Read as they are, read as another character, marked unreadable, not given at all: together
    #: all characters.
    right: int = 0
    wrong: int = 0
    unreadable: int = 0
    missed: int = 0
    #: Characters given where there is none; those marked unreadable included.
    extra: int = 0
    #: Those of them that were given as readable: with `wrong`, what a user would be misled by.
    extra_readable: int = 0
    #: True words, and the edits (words changed, missing or too many) from what was read to them.
    words: int = 0
    wrong_words: int = 0

    def __add__(self, other: Score) -> Score:
        return Score(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def misread(self) -> int:
        """Characters given as readable that aren't what is there."""
        return self.wrong + self.extra_readable

    @property
    def character_accuracy(self) -> float:
        """Share of the true characters that were read right."""
        return self.right / max(self.characters, 1)

    @property
    def character_error_rate(self) -> float:
        """Edits (changed, missed and extra characters) by true characters."""
        edits = self.wrong + self.unreadable + self.missed + self.extra
        return edits / max(self.characters, 1)

    @property
    def word_error_rate(self) -> float:
        """Edits of words by true words."""
        return self.wrong_words / max(self.words, 1)


def score(read: Sequence[str], true: Sequence[str]) -> Score:
    """Compare lines that were read with the true ones.

    Of the alignments with the fewest edits, one that pairs unreadable characters with true ones is
    taken. The ends of lines are aligned too, but not counted.

    Parameters
    ----------
    read : sequence of str
        Lines; U+FFFD stands for a cell that couldn't be read.
    true : sequence of str
        The lines that are there.
    """
    counts = {"characters": sum(map(len, true))}

    def count(name: str) -> None:
        counts[name] = counts.get(name, 0) + 1

    for given, there in align("\n".join(read), "\n".join(true)):
        if "\n" in (given, there):
            continue
        if there == "":
            count("extra")
            if given != UNREADABLE:
                count("extra_readable")
        elif given == there:
            count("right")
        elif given == "":
            count("missed")
        else:
            count("unreadable" if given == UNREADABLE else "wrong")
    words = [word for line in true for word in line.split()]
    pairs = align([word for line in read for word in line.split()], words)
    return Score(**counts, words=len(words), wrong_words=sum(a != b for a, b in pairs))


def align(read: Sequence[str], true: Sequence[str]) -> list[tuple[str, str]]:
    """Pairs (read, true) of the alignment with the fewest edits; "" where one has nothing.

    An end of line is never paired with another character.
    """
    cost = _costs(read, true)
    i, j, pairs = len(read), len(true), []
    while i or j:
        if i and j and cost[i, j] == cost[i - 1, j - 1] + _change(read[i - 1], true[j - 1]):
            i, j = i - 1, j - 1
            pairs.append((read[i], true[j]))
        elif j and cost[i, j] == cost[i, j - 1] + _EDIT:
            j -= 1
            pairs.append(("", true[j]))
        else:
            i -= 1
            pairs.append((read[i], ""))
    return pairs[::-1]


#: Costs are whole numbers, so that sums compare exactly; the odd unit breaks ties.
_EDIT = 1000


def _change(given: str, there: str) -> int:
    if given == there:
        return 0
    if "\n" in (given, there):
        return 3 * _EDIT
    return _EDIT - 1 if given == UNREADABLE else _EDIT


def _costs(read: Sequence[str], true: Sequence[str]) -> npt.NDArray[np.int64]:
    cost = np.zeros((len(read) + 1, len(true) + 1), np.int64)
    cost[:, 0] = np.arange(len(read) + 1) * _EDIT
    cost[0] = np.arange(len(true) + 1) * _EDIT
    for i, given in enumerate(read, 1):
        for j, there in enumerate(true, 1):
            cost[i, j] = min(
                cost[i - 1, j - 1] + _change(given, there),
                cost[i - 1, j] + _EDIT,
                cost[i, j - 1] + _EDIT,
            )
    return cost
