"""The lattice of a line of Braille: where its rows, its cells and their dots lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from . import _lattice_kernels as kernels
from .dots import Dots
from .reader_settings import Spacing
from .warp import F64

#: A dot this far off its node, in dot pitches, has no part in it.
REACH = 0.25
#: Largest error of the pitches that is looked for, as a share, and the pitches that are tried.
_TOLERANCE, _SCALES = 0.04, 7
#: Spots weaker than this, against the strong ones (the third strongest), are dust. Tuned on the
#: virtual cell.
FAINT = 0.25
_STRONG = 3
_STEP_M = 0.0001
#: Lines are no nearer to each other than this, in line pitches.
LEAST_LINE_PITCH = 0.8
#: Fewer dots beside the rows of a line are taken for none of another.
_LEAST_REST = 2
#: Where dots fit several rows or columns alike, the upper row and the left column are taken.
_PREFERENCE = 0.06
#: And how much the largest error of the pitches counts against them.
_UNEVEN = 0.01
#: How much the lattice's parameters are taken to differ from those expected, for the fit:
#: offset along, cell pitch, dot pitch along, offset down, turn, dot pitch down.
_PRIOR = np.array([1e-3, 0.01, 0.03, 1e-3, 0.01, 0.03])
_DOT_SIGMA_M = 1.5e-4
#: A dot this far off its node says nothing for the lattice.
_CLOSE_M = 4e-4
#: Largest turn of a line that is looked for, radians; the angles that are tried, how far dots of
#: a row may lie beside each other, fewest dots, and how much the largest turn counts against it.
MOST_TURN = float(np.radians(12.0))
_TURNS = np.linspace(-MOST_TURN, MOST_TURN, 49)
_ROW_M, _TURN_DOTS, _STRAIGHT = 4e-4, 4, 0.1


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


def no_dust(votes: F64) -> npt.NDArray[np.bool_]:
    """Which spots are not far weaker than the strong ones among them, shape (n,)."""
    return np.asarray(votes >= dust(votes))


def dust(votes: F64) -> float:
    """Events below which spots are dust beside the strong ones of some, shape (n,), n > 0."""
    return FAINT * float(np.sort(votes)[-min(_STRONG, len(votes))])


def find_lattice(
    dots: Dots, spacing: Spacing, left_first: bool, angle: float = 0.0, begins_m: float = np.inf
) -> Lattice | None:
    """The lattice on which the most dots of one line lie.

    Parameters
    ----------
    dots : Dots
        Dots of a few cells; of several lines perhaps, and others.
    spacing : Spacing
        Expected pitches.
    left_first : bool
        Whether the left column of a cell comes first in travel.
    angle : float
        Turn of the line, radians, nearly.
    begins_m : float
        Travel up to which its first dot lies.

    Returns
    -------
    Lattice or None
        Its cell 0 holds the first of the line's dots; None without dots, or where its rows begin
        later.
    """
    if not len(dots):
        return None
    # Dust is no dot; left in, it could move the rows.
    dots = dots.where(no_dust(dots.votes))
    weight = np.minimum(dots.votes, 2 * np.median(dots.votes))
    scales = np.linspace(1 - _TOLERANCE, 1 + _TOLERANCE, _SCALES)
    width, apart = REACH * spacing.dot_pitch_m, LEAST_LINE_PITCH * spacing.line_pitch_m
    pitches = spacing.cell_pitch_m, spacing.dot_pitch_m, spacing.dot_pitch_m
    axes = Lattice(float(dots.along[0]), float(dots.down[0]), *pitches, angle)
    own_along, own_down = axes.own(dots)
    others: list[float] = []
    while True:
        found = _find_rows(own_down, weight, spacing.dot_pitch_m * scales, width, others, apart)
        down, pitch_down, near = found
        if (near & (dots.along <= begins_m)).any():
            break
        # Rows of another line, which begins later: dots of this one lie outside its band, and its
        # rows as far off as those of two lines are.
        half = (spacing.line_pitch_m - 2 * spacing.dot_pitch_m) / 2
        rest = np.abs(own_down - down - pitch_down) > pitch_down + half
        if int(rest.sum()) < _LEAST_REST or not (rest & (dots.along <= begins_m)).any():
            return None
        dots, weight = dots.where(rest), weight[rest]
        own_along, own_down = own_along[rest], own_down[rest]
        others.append(down)
    along, cell = _find_cells(
        own_along[near], weight[near], spacing, scales, width, 0 if left_first else 1
    )
    rough = replace(axes.shifted(along, down), cell=cell, dot_down=pitch_down)
    on, index = rough.assign(dots)
    if not on.any():
        return None
    rough = rough.moved(int(index[on, 0].min()))
    return rough.fitted(dots, spacing)


def find_turn(dots: Dots, spacing: Spacing) -> float:
    """The angle under which the most dots lie in rows, radians.

    Parameters
    ----------
    dots : Dots
        Dots of some cells, of several lines perhaps.
    spacing : Spacing
        Expected pitches.

    Returns
    -------
    float
        Up to `MOST_TURN` either way; 0 where there are too few dots.
    """
    if len(dots) < _TURN_DOTS:
        return 0.0
    dots = dots.where(no_dust(dots.votes))
    weight = np.minimum(dots.votes, 2 * np.median(dots.votes))
    # Pairs in one row; dots of one cell are too near each other to tell the angle.
    apart, score = 1.5 * spacing.dot_pitch_m, np.zeros(len(_TURNS))
    kernels._score_turns(
        dots.along, dots.down, weight, apart, np.cos(_TURNS), np.sin(_TURNS), _ROW_M, score
    )
    score *= 1.0 - _STRAIGHT * np.abs(_TURNS) / MOST_TURN
    return float(_TURNS[int(np.argmax(score))])


def _find_rows(
    down: F64,
    weight: F64,
    pitches: F64,
    width: float,
    others: Sequence[float] = (),
    apart: float = 0.0,
) -> tuple[float, float, npt.NDArray[np.bool_]]:
    """Top row and pitch of three rows that hold the most weight, and the dots on them.

    None within a distance of the top rows of other lines, as far as dots reach beyond it.
    """
    top = np.arange(down.min() - 2 * pitches.max(), down.max() + _STEP_M, _STEP_M)
    total = np.zeros((len(top), len(pitches)))
    # Straighter pitches and upper rows win where the dots leave it open.
    shares = 1 - _PREFERENCE * np.arange(3)
    kernels._score_rows(down, weight, top, _STEP_M, pitches, width, shares, total)
    for other in others:
        total[np.abs(top - other) < apart] = 0.0
    k, s = np.unravel_index(int(np.argmax(total * _even(len(pitches)))), total.shape)
    rows = top[k] + pitches[s] * np.arange(3)
    near = np.abs(rows[:, None] - down).min(axis=0) < 2 * width
    return float(top[k]), float(pitches[s]), near


def _find_cells(
    along: F64, weight: F64, spacing: Spacing, scales: F64, width: float, favoured: int
) -> tuple[float, float]:
    """Place of a cell's first column, and the pitch, under which the most weight lies."""
    cells = spacing.cell_pitch_m * scales
    start = np.arange(0.0, spacing.cell_pitch_m, _STEP_M)
    first, total = along.min(), np.zeros((len(start), len(cells)))
    less = 1.0 - _PREFERENCE
    shares = (1.0, less) if favoured == 0 else (less, 1.0)
    kernels._score_cells(
        along - first, weight, start, cells, spacing.dot_pitch_m, width, shares, total
    )
    k, s = np.unravel_index(int(np.argmax(total * _even(len(cells)))), total.shape)
    return float(first + start[k]), float(cells[s])


def _even(count: int) -> F64:
    """What pitches count by their number: those in the middle most."""
    middle = (count - 1) / 2
    return np.asarray(1 - _UNEVEN * np.abs(np.arange(count) - middle) / max(middle, 1))
