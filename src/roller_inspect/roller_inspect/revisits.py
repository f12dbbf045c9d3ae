"""A scan that comes back to the same place after a pause: another part lies there."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

I64 = npt.NDArray[np.int64]

#: Side of the squares by which places are told apart, m, and the share of a cloud's squares that
#: must have been seen before.
_SQUARE_M, _SAME = 1e-3, 0.5
#: Of so many points one is looked at.
_EVERY = 8
#: Number of a square: by its row and so much of its column; more rows than any part has.
_COLUMN = 2**31


class Revisits:
    """Tells the points of another part from further passes over the same one.

    Strips side by side are of one part, however long the robot takes between them; passes over the
    same strip are, if they follow each other at once.

    Parameters
    ----------
    pause_s : float
        How long there are no points before another part.
    """

    def __init__(self, pause_s: float) -> None:
        self._pause_ns = round(pause_s * 1e9)
        self.begin()

    def begin(self) -> None:
        """Another part follows."""
        self._seen: list[I64] = []
        self._last_ns: int | None = None

    def again(self, points: F64, t_ns: int) -> bool:
        """Whether points, shape (n, 3), metres, in base, seen at a time, ns, are of another part.

        If they aren't, what follows is held against them too.
        """
        squares = np.floor(points[::_EVERY, :2] / _SQUARE_M).astype(np.int64)
        places = np.unique(squares[:, 0] * _COLUMN + squares[:, 1])
        paused = self._last_ns is not None and t_ns - self._last_ns > self._pause_ns
        if paused and np.isin(places, np.concatenate(self._seen)).mean() >= _SAME:
            return True
        self._seen.append(places)
        self._last_ns = t_ns
        return False
