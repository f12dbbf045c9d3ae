"""Finding the lattice of a line under spots: its turn, its rows, its cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from . import _lattice_kernels as kernels
from .dots import Dots
from .lattice import REACH, Lattice
from .reader_settings import Spacing
from .warp import F64

#: Largest error of the pitches that is looked for, as a share, and the pitches that are tried.
_TOLERANCE, _SCALES = 0.04, 7
#: Spots weaker than this, against the strong ones (the third strongest), are outliers. Tuned on the
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
#: Largest turn of a line that is looked for, radians; the angles that are tried, how far dots of
#: a row may lie beside each other, fewest dots, and how much the largest turn counts against it.
MOST_TURN = float(np.radians(12.0))
_TURNS = np.linspace(-MOST_TURN, MOST_TURN, 49)
_ROW_M, _TURN_DOTS, _STRAIGHT = 4e-4, 4, 0.1


def are_strong(votes: F64) -> npt.NDArray[np.bool_]:
    """Which spots are not far weaker than the strong ones among them, shape (n,)."""
    return np.asarray(votes >= least_votes(votes))


def least_votes(votes: F64) -> float:
    """Events below which spots are outliers beside the strong ones of some, shape (n,), n > 0."""
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
    dots = dots.where(are_strong(dots.votes))
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
    dots = dots.where(are_strong(dots.votes))
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
