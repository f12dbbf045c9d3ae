"""The lattice of a line of Braille: where its rows, its cells and their dots lie."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from . import _lattice_kernels as kernels
from .dots import Dots
from .reader_settings import Spacing
from .warp import F64

#: A dot this far off its node, in dot pitches, has no part in it.
REACH = 0.25
#: How much the lattice's parameters are taken to differ from those expected, for the fit:
#: offset along, cell pitch, dot pitch along, offset down, turn, dot pitch down.
_PRIOR = np.array([1e-3, 0.01, 0.03, 1e-3, 0.01, 0.03])
_DOT_SIGMA_M = 1.5e-4
#: A dot this far off its node says nothing for the lattice.
_CLOSE_M = 4e-4


@dataclass(frozen=True)
class Lattice:
    """Nodes of a line, in travel along the roll and place down the image, metres."""

    #: Node of the first column (in travel) and top row of cell 0.
    along: float
    down: float
    #: Pitch of cells along the line, and of dots along the line and across it.
    cell: float
    dot_along: float
    dot_down: float
    #: Turn of the line, radians, positive where it goes down along the travel.
    angle: float = 0.0

    def nodes(self, n: int) -> F64:
        """Nodes of cell n: its first column from the top, then the second.

        Returns
        -------
        ndarray of float64, shape (6, 2)
            Travel along the roll and place down the image, metres.
        """
        column, row = np.repeat([0, 1], 3), np.tile([0, 1, 2], 2)
        return self.places(n * self.cell + column * self.dot_along, row * self.dot_down)

    def places(self, along: npt.ArrayLike, down: npt.ArrayLike) -> F64:
        """Travel and place down the image, shape (n, 2), of places in the line's own axes."""
        x, y = np.asarray(along, np.float64), np.asarray(down, np.float64)
        c, s = math.cos(self.angle), math.sin(self.angle)
        travel = self.along + c * x - s * y
        out = np.empty((*np.shape(travel), 2))
        out[..., 0] = travel
        out[..., 1] = self.down + s * x + c * y
        return out

    def own(self, dots: Dots) -> tuple[F64, F64]:
        """Places of dots along the line and across it, metres, from the first node of cell 0."""
        x, y = dots.along - self.along, dots.down - self.down
        c, s = math.cos(self.angle), math.sin(self.angle)
        return c * x + s * y, c * y - s * x

    @property
    def begin(self) -> float:
        """Travel at which the tile of cell 0 begins, half way from the cell before, metres."""
        return float(self.places((self.dot_along - self.cell) / 2, self.dot_down)[0])

    @property
    def end(self) -> float:
        """Travel at which all of cell 0 was passed, half way to the next, metres."""
        margin = self.cell - self.dot_along
        ends = self.places(
            (self.dot_along + self.cell) / 2, [-margin / 4, 2 * self.dot_down + margin / 4]
        )
        return float(ends[:, 0].max())

    def tile(self, half_m: float) -> F64:
        """Corners of cell 0's tile: half way to its neighbours, and so far across its middle row.

        Returns
        -------
        ndarray of float64, shape (4, 2)
            As `nodes`.
        """
        middle = self.dot_along / 2
        along = middle + self.cell / 2 * np.array([-1, 1, 1, -1])
        return self.places(along, self.dot_down + half_m * np.array([-1, -1, 1, 1]))

    def centre(self, n: int) -> tuple[float, float]:
        """Middle of cell n."""
        along, down = self.places(n * self.cell + self.dot_along / 2, self.dot_down)
        return float(along), float(down)

    def top_at(self, along: float) -> float:
        """Distance down the image of the top row at a place along the roll, metres."""
        return self.down + float(np.tan(self.angle)) * (along - self.along)

    def assign(self, dots: Dots) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.int64]]:
        """Which dots lie on nodes, shape (n,), and their cell, column and row, shape (n, 3)."""
        index, off = self._nearest(dots)
        return off <= REACH * self.dot_down, index

    def off(self, dots: Dots) -> F64:
        """How far dots lie off the node that is nearest to each, metres, shape (n,)."""
        return self._nearest(dots)[1]

    def fit_of(self, dots: Dots) -> float:
        """How well dots lie on nodes: their number, each the less the further it is off."""
        return _fit(self._nearest(dots)[1])

    def column_off(self, dots: Dots) -> F64:
        """As `off` where the columns have more nodes, in rows above and below."""
        along, down = self.own(dots)
        inside = along - np.floor((along - self.dot_along / 2) / self.cell + 0.5) * self.cell
        beside = inside - np.where(inside > self.dot_along / 2, self.dot_along, 0.0)
        return np.hypot(beside, down - np.rint(down / self.dot_down) * self.dot_down)

    def column_fit(self, dots: Dots) -> float:
        """As `fit_of` where the columns have more nodes, in rows above and below."""
        return _fit(self.column_off(dots))

    def _nearest(self, dots: Dots) -> tuple[npt.NDArray[np.int64], F64]:
        index, off = np.empty((len(dots), 3), np.int64), np.empty(len(dots))
        kernels._nearest(dots.along, dots.down, self._numbers, index, off)
        return index, off

    @property
    def _numbers(self) -> tuple[float, float, float, float, float, float, float]:
        """What kernels take of it."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.along, self.down, self.cell, self.dot_along, self.dot_down, c, s

    def fitted(self, dots: Dots, spacing: Spacing) -> Lattice:
        """The lattice moved, turned and stretched a little to lie best under dots.

        Parameters
        ----------
        dots : Dots
            Dots; those off the lattice are passed over.
        spacing : Spacing
            Pitches that the fit is drawn to where the dots leave them open.
        """
        on, index = self.assign(dots)
        if not on.any():
            return self
        cell, dot = spacing.cell_pitch_m, spacing.dot_pitch_m
        x = np.empty(6)
        kernels._fit(
            dots.along, dots.down, self._numbers, index, on, (cell, dot), _DOT_SIGMA_M, _PRIOR, x
        )
        place = self.places(x[0], x[3])
        return Lattice(
            float(place[0]),
            float(place[1]),
            float(cell * (1 + x[1])),
            float(dot * (1 + x[2])),
            float(dot * (1 + x[5])),
            float(self.angle + x[4]),
        )

    def moved(self, n: int) -> Lattice:
        """The same lattice, its cells counted from cell n on."""
        return self.shifted(n * self.cell, 0.0)

    def shifted(self, along: float, down: float) -> Lattice:
        """The same lattice, moved so far along the line and across it, metres."""
        place = self.places(along, down)
        return replace(self, along=float(place[0]), down=float(place[1]))


def _fit(off: F64) -> float:
    return float(np.maximum(1.0 - (off / _CLOSE_M) ** 2, 0.0).sum())
