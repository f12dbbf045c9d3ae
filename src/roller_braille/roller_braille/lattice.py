"""The lattice of a line of Braille: where its rows, its cells and their dots lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .dots import Dots
from .settings import Spacing
from .warp import F64

#: A dot this far off its node, in dot pitches, has no part in it.
REACH = 0.25
_SCALES = 7
#: Spots weaker than this, against the strong ones (the third strongest), are dust.
_FAINT = 0.06
_STRONG = 3
_STEP_M = 0.0001
#: Where dots fit several rows or columns alike, the upper row and the left column are taken.
_PREFERENCE = 0.06
#: And how much the largest error of the pitches counts against them.
_UNEVEN = 0.01
#: How much the lattice's parameters are taken to differ from those expected, for the fit:
#: offset along, cell pitch, dot pitch along, offset down, slope, dot pitch down.
_PRIOR = np.array([1e-3, 0.01, 0.01, 1e-3, 0.01, 0.03])
_DOT_SIGMA_M = 1.5e-4


@dataclass(frozen=True)
class Lattice:
    """Nodes of a line, in travel along the roll and way down the image, metres.

    Attributes
    ----------
    along, down : float
        Node of the first column (in travel) and top row of cell 0.
    cell, dot_along, dot_down : float
        Pitch of cells along the roll, and of dots along and down.
    slope : float
        Way down a unit of travel.
    """

    along: float
    down: float
    cell: float
    dot_along: float
    dot_down: float
    slope: float = 0.0

    def nodes(self, n: int) -> F64:
        """Nodes of cell n: its first column from the top, then the second.

        Returns
        -------
        ndarray of float64, shape (6, 2)
            Travel along the roll and way down the image, metres.
        """
        column, row = np.repeat([0, 1], 3), np.tile([0, 1, 2], 2)
        along = self.along + n * self.cell + column * self.dot_along
        down = self.down + row * self.dot_down + self.slope * (along - self.along)
        return np.stack([along, down], axis=-1)

    @property
    def begin(self) -> float:
        """Travel at which the tile of cell 0 begins, half way from the cell before, metres."""
        return self.along + (self.dot_along - self.cell) / 2

    def centre(self, n: int) -> tuple[float, float]:
        """Middle of cell n."""
        along = self.along + n * self.cell + self.dot_along / 2
        return along, self.down + self.dot_down + self.slope * (along - self.along)

    def cell_of(self, along: float) -> int:
        """Cell that a place along the roll belongs to."""
        return int(np.floor((along - self.along - self.dot_along / 2) / self.cell + 0.5))

    def assign(self, dots: Dots) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.int64]]:
        """Which dots lie on nodes, shape (n,), and their cell, column and row, shape (n, 3)."""
        rest = dots.along - self.along
        down = dots.down - self.down - self.slope * rest
        n = np.floor((rest - self.dot_along / 2) / self.cell + 0.5)
        inside = rest - n * self.cell
        column = (inside > self.dot_along / 2).astype(np.float64)
        row = np.clip(np.round(down / self.dot_down), 0, 2)
        off = np.hypot(inside - column * self.dot_along, down - row * self.dot_down)
        return off <= REACH * self.dot_down, np.stack([n, column, row], axis=-1).astype(np.int64)

    def fitted(self, dots: Dots, spacing: Spacing) -> Lattice:
        """The lattice moved and stretched a little to lie best under dots.

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
        n, column, row = index[on].T.astype(np.float64)
        along, down = dots.along[on] - self.along, dots.down[on] - self.down
        zero, one = np.zeros_like(n), np.ones_like(n)
        cell, dot = spacing.cell_pitch_m, spacing.dot_pitch_m
        # Unknowns: offset, relative change of cell and dot pitch; then offset, slope, dot pitch.
        design = np.concatenate(
            [
                np.stack([one, n * cell, column * dot, zero, zero, zero], -1),
                np.stack([zero, zero, zero, one, along, row * dot], -1),
            ]
        )
        target = np.concatenate([along - n * cell - column * dot, down - row * dot])
        a = design / _DOT_SIGMA_M
        left = a.T @ a + np.diag(_PRIOR**-2.0)
        x = np.linalg.solve(left, a.T @ (target / _DOT_SIGMA_M))
        return Lattice(
            float(self.along + x[0]),
            float(self.down + x[3]),
            float(cell * (1 + x[1])),
            float(dot * (1 + x[2])),
            float(dot * (1 + x[5])),
            float(x[4]),
        )

    def moved(self, n: int) -> Lattice:
        """The same lattice, its cells counted from cell n on."""
        along = self.along + n * self.cell
        down = self.down + self.slope * n * self.cell
        return Lattice(along, down, self.cell, self.dot_along, self.dot_down, self.slope)


def no_dust(votes: F64) -> npt.NDArray[np.bool_]:
    """Which spots are not far weaker than the strong ones among them, shape (n,)."""
    return np.asarray(votes >= _FAINT * np.sort(votes)[-min(_STRONG, len(votes))])


def find_lattice(
    dots: Dots, spacing: Spacing, tolerance: float, left_first: bool
) -> Lattice | None:
    """The lattice on which the most dots of one line lie.

    Parameters
    ----------
    dots : Dots
        Dots of a few cells; of several lines perhaps, and others.
    spacing : Spacing
        Expected pitches.
    tolerance : float
        Largest error of the pitches, as a share.
    left_first : bool
        Whether the left column of a cell comes first in travel.

    Returns
    -------
    Lattice or None
        Its cell 0 holds the first of the line's dots; None without dots.
    """
    if not len(dots):
        return None
    # Dust is no dot; left in, it could move the rows.
    dots = dots.where(no_dust(dots.votes))
    weight = np.minimum(dots.votes, 2 * np.median(dots.votes))
    scales = np.linspace(1 - tolerance, 1 + tolerance, _SCALES)
    width = REACH * spacing.dot_pitch_m
    down, pitch_down, near = _find_rows(dots.down, weight, spacing.dot_pitch_m * scales, width)
    if not near.any():
        return None
    along, cell = _find_cells(
        dots.along[near], weight[near], spacing, scales, width, 0 if left_first else 1
    )
    rough = Lattice(along, down, cell, spacing.dot_pitch_m, pitch_down)
    on, index = rough.assign(dots)
    if not on.any():
        return None
    rough = rough.moved(int(index[on, 0].min()))
    return rough.fitted(dots, spacing)


def _near(distance: F64, width: float) -> F64:
    return np.asarray(np.maximum(1.0 - np.abs(distance) / (2 * width), 0.0))


def _find_rows(
    down: F64, weight: F64, pitches: F64, width: float
) -> tuple[float, float, npt.NDArray[np.bool_]]:
    """Top row and pitch of three rows that hold the most weight, and the dots on them."""
    top = np.arange(down.min() - 2 * pitches.max(), down.max() + _STEP_M, _STEP_M)
    rows = top[:, None, None] + pitches[None, :, None] * np.arange(3)
    # (top, pitch, row, dot)
    fit = _near(rows[..., None] - down, width)
    score = (fit * weight).sum(axis=-1)
    # Straighter pitches and upper rows win where the dots leave it open.
    middle = (len(pitches) - 1) / 2
    even = 1 - _UNEVEN * np.abs(np.arange(len(pitches)) - middle) / max(middle, 1)
    total = (score * (1 - _PREFERENCE * np.arange(3))).sum(axis=-1) * even
    k, s = np.unravel_index(int(np.argmax(total)), total.shape)
    return float(top[k]), float(pitches[s]), fit[k, s].max(axis=0) > 0


def _find_cells(
    along: F64, weight: F64, spacing: Spacing, scales: F64, width: float, favoured: int
) -> tuple[float, float]:
    """Place of a cell's first column, and the pitch, under which the most weight lies."""
    cells = spacing.cell_pitch_m * scales
    start = np.arange(0.0, spacing.cell_pitch_m, _STEP_M)
    first = along.min()
    # (start, pitch, dot)
    rest = (along - first - start[:, None, None]) / cells[:, None]
    rest = (rest - np.floor(rest)) * cells[:, None]
    score = np.zeros(rest.shape)
    for column in (0, 1):
        d = rest - column * spacing.dot_pitch_m
        d = np.minimum(np.abs(d), np.abs(d - cells[:, None]))
        d = np.minimum(d, np.abs(rest + cells[:, None] - column * spacing.dot_pitch_m))
        favour = 1.0 if column == favoured else 1.0 - _PREFERENCE
        score = np.maximum(score, _near(d, width) * favour)
    middle = (len(cells) - 1) / 2
    even = 1 - _UNEVEN * np.abs(np.arange(len(cells)) - middle) / max(middle, 1)
    total = (score * weight).sum(axis=-1) * even
    k, s = np.unravel_index(int(np.argmax(total)), total.shape)
    return float(first + start[k]), float(cells[s])
