"""Where cells are that were read, so that they are known when they are seen again."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import numpy.typing as npt

from .warp import F64

_Bin = tuple[int, int, int]


class KnownCells:
    """Places of the newest cells; looking near one takes as long however many there are.

    Parameters
    ----------
    reach_m : float
        How far `near` sees, metres.
    most : int
        Cells that are remembered; beyond it the oldest is forgotten.

    Attributes
    ----------
    count : int
        Cells that were ever added: the number of the next one.
    """

    def __init__(self, reach_m: float, most: int) -> None:
        self.count = 0
        self._reach_m, self._most = reach_m, most
        self._places = np.empty((0, 3))
        self._where = np.empty((0, 2), np.int32)
        self._bins: dict[_Bin, list[int]] = defaultdict(list)

    def add(self, place: F64, line: int, column: int) -> tuple[int, int] | None:
        """Remember a cell.

        Parameters
        ----------
        place : ndarray of float64, shape (3,)
            Metres.
        line, column : int
            Where it stands in the text.

        Returns
        -------
        tuple of int or None
            Line and column of the cell that is forgotten for it.
        """
        row, forgotten = self.count % self._most, None
        if self.count >= self._most:
            forgotten = self.where(self.count - self._most)
            self._forget(row)
        elif row == len(self._places):
            size = min(max(2 * row, 64), self._most)
            self._places = np.resize(self._places, (size, 3))
            self._where = np.resize(self._where, (size, 2))
        self._places[row], self._where[row] = place, (line, column)
        self._bins[self._bin(place)].append(self.count)
        self.count += 1
        return forgotten

    def near(self, place: F64) -> tuple[list[int], F64]:
        """Numbers of the cells within reach of a place, and some more, and their places (n, 3)."""
        x, y, z = self._bin(place)
        around = (-1, 0, 1)
        bins = ((x + i, y + j, z + k) for i in around for j in around for k in around)
        numbers = sorted(n for b in bins for n in self._bins.get(b, ()))
        return numbers, self._places[[n % self._most for n in numbers]]

    def where(self, number: int) -> tuple[int, int]:
        """Line and column of a cell."""
        line, column = self._where[number % self._most]
        return int(line), int(column)

    def _forget(self, row: int) -> None:
        key = self._bin(self._places[row])
        self._bins[key].pop(0)  # the oldest of all is the oldest there
        if not self._bins[key]:
            del self._bins[key]

    def _bin(self, place: npt.NDArray[np.float64]) -> _Bin:
        x, y, z = np.floor(place / self._reach_m).astype(int).tolist()
        return x, y, z
