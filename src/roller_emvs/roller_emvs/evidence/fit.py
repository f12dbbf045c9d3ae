"""The surface through depths on a grid of cells, and how far those around a place agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _fit_kernels as kernels
from .blur import blurred
from .field import I32
from .sweep import Depths

#: Neighbourhood whose depths are taken to scatter alike, cells.
_ALIKE = 1.5
#: Share of what a fit leaves over that is put back. A plane through a neighbourhood levels
#: crests and hollows; its residuals say by how much (Tukey's twicing gives back 1). Evidence is
#: itself of a neighbourhood, which levels as much again.
_GIVEN_BACK = 1.5


@dataclass(frozen=True)
class Moments:
    """Of the depths around each cell by polarity; first axis."""

    #: Weights of the depths, and rows and columns of the cells that their evidence lies in. Shapes
    #: (polarities, rows, columns) and (polarities, 2, rows, columns).
    weight: F32
    place: I32
    #: See `_fit_kernels._add_moments`, summed over neighbourhoods. Shape (polarities, 9, rows,
    #: columns).
    sums: F32


@dataclass(frozen=True)
class Fit:
    """Surface on cells, float32, shape (rows, columns); NaN where nothing is near."""

    #: The surface.
    offset: F32
    #: Deviation of the depths around from it, more where a few carry the weight. Depths of
    #: neighbouring cells share their evidence, so their number doesn't make it less.
    scatter: F32
    #: By how much each polarity counts. Shape (polarities, rows, columns).
    shares: F32
    #: What it was made from.
    moments: Moments


def fit_planes(
    depths: list[Depths],
    sigma: float,
    resolution: float,
    threads: int = 1,
    scattered: bool = True,
    like: Fit | None = None,
    given_back: float = _GIVEN_BACK,
) -> Fit:
    """Surface by planes through the depths around each cell.

    A depth belongs to where its evidence lies, which on a wall is not the cell that it was
    summed for; the slope comes from neighbouring edges. Edges of one polarity may scatter more
    than those of the other, as those that drift with the light do: each counts by the inverse of
    its variance about its own plane.

    Parameters
    ----------
    depths : list of Depths
        On the grid's cells, by polarity.
    sigma : float
        Neighbourhood, in cells.
    resolution : float
        Deviation of a depth that scatters no more than its evidence can resolve, in offset.
    threads : int
        Threads that share the work.
    scattered : bool
        Whether `scatter` is wanted.
    like : Fit, optional
        Of depths that differ from these in nothing but their offsets: it has what hangs on their
        places alone.
    given_back : float
        Share of what the planes leave over that is put back.
    """
    shape, real = depths[0].offset.shape, np.float32
    count = len(depths)
    # From the grid's middle, so that float32 tells squares of places apart.
    middle = real(shape[1] // 2), real(shape[0] // 2)
    values = [(own.offset, own.x - middle[0], own.y - middle[1]) for own in depths]
    trust = np.empty((count, *shape), real)
    if like is None:
        weight, place = np.empty((count, *shape), real), np.empty((count, 2, *shape), np.int32)
        summed = np.zeros((count, 9, *shape), real)
    else:
        weight, place, summed = like.moments.weight, like.moments.place, like.moments.sums.copy()
        summed[:, kernels.OF_OFFSET] = 0

    def judge(k: int) -> None:
        """Moments around each cell of a polarity, and the inverse of its variance there."""
        found, (row, column), own = depths[k], place[k], summed[k]
        if like is None:
            kernels._weigh(
                found.offset, found.x, found.y, found.focus_measure, row, column, weight[k]
            )
            kernels._add_moments(*values[k], weight[k], row, column, own)
            own[:] = blurred(own, sigma)
        else:
            kernels._add_offsets(*values[k], weight[k], row, column, own)
            own[kernels.OF_OFFSET] = blurred(own[kernels.OF_OFFSET], sigma)
        planes, alike = np.empty((5, *shape), real), np.ones(shape, real)
        sums = np.zeros((4, *shape), real)
        kernels._solve(own, planes)
        kernels._add_residuals(*values[k], weight[k], row, column, alike, planes, sums)
        weights, squares = blurred(sums[1:3], _ALIKE)
        kernels._trust(weights, squares, resolution**2, trust[k])

    share(threads, count, judge)
    planes, sums = np.empty((5, *shape), real), np.zeros((4, *shape), real)
    at_cell, scatter = np.empty(shape, real), np.empty(shape if scattered else (0, 0), real)
    total = summed[0] * trust[0]
    for own, by in zip(summed[1:], trust[1:], strict=True):
        total += own * by
    shares = summed[:, 0] * trust / np.maximum(total[0], real(1e-9))
    kernels._solve(total, planes)
    for each, w, (row, column), t in zip(values, weight, place, trust, strict=True):
        kernels._add_residuals(*each, w, row, column, t, planes, sums)
    # Height at the cell's own centre plus slope: linear, so enlarging keeps it.
    rests, weights = blurred(sums[:2], sigma)
    kernels._at_cells(planes, middle, weights, rests, given_back, at_cell)
    if scattered:
        kernels._scatter(*blurred(sums[1:], _ALIKE), scatter)
    return Fit(at_cell, scatter, shares, Moments(weight, place, summed))
