"""The surface through depths on a grid of cells, and how far those around a place agree."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _fit_kernels as kernels
from .sweep import Depths

#: Neighbourhood whose depths are taken to scatter alike, cells.
_ALIKE = 1.5
#: Share of what a fit leaves over that is put back. A plane through a neighbourhood levels
#: crests and hollows; its residuals say by how much (Tukey's twicing gives back 1). Evidence is
#: itself of a neighbourhood, which levels as much again.
_GIVEN_BACK = 1.5


@dataclass(frozen=True)
class Fit:
    """Surface on cells, float32, shape (rows, columns); NaN where nothing is near."""

    #: The surface.
    offset: F32
    #: Deviation of the depths around from it, more where a few carry the weight. Depths of
    #: neighbouring cells share their evidence, so their number doesn't make it less.
    scatter: F32


def fit_planes(depths: list[Depths], sigma: float, resolution: float, threads: int = 1) -> Fit:
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
    """
    shape, real = depths[0].offset.shape, np.float32
    count, (rows, columns) = len(depths), np.ogrid[: shape[0], : shape[1]]
    # From the grid's middle, so that float32 tells squares of places apart.
    middle = real(shape[1] // 2), real(shape[0] // 2)
    values = [(own.offset, own.x - middle[0], own.y - middle[1]) for own in depths]
    summed, trust = np.zeros((count, 9, *shape), real), np.empty((count, *shape), real)
    weight, place = np.empty((count, *shape), real), np.empty((count, 2, *shape), np.int32)

    def judge(k: int) -> None:
        """Moments around each cell of a polarity, and the inverse of its variance there."""
        found, (row, column) = depths[k], place[k]
        kernels._weigh(found.offset, found.x, found.y, found.focus_measure, row, column, weight[k])
        kernels._add_moments(*values[k], weight[k], row, column, summed[k])
        for moment in summed[k]:
            cv2.GaussianBlur(moment, (0, 0), sigma, dst=moment)
        planes, alike = np.empty((5, *shape), real), np.ones(shape, real)
        sums = np.zeros((4, *shape), real)
        kernels._solve(summed[k], planes)
        kernels._add_residuals(*values[k], weight[k], row, column, alike, planes, sums)
        variance = _blur(sums[3], _ALIKE) / np.maximum(_blur(sums[0], _ALIKE), real(1e-12))
        np.divide(real(resolution**2), variance + real(resolution**2), out=trust[k])
        summed[k] *= trust[k]

    share(threads, count, judge)
    planes, sums = np.empty((5, *shape), real), np.zeros((4, *shape), real)
    kernels._solve(summed.sum(axis=0), planes)
    for own, w, (row, column), t in zip(values, weight, place, trust, strict=True):
        kernels._add_residuals(*own, w, row, column, t, planes, sums)
    x, y, z, slope_x, slope_y = planes
    # Height at the cell's own centre plus slope: linear, so enlarging keeps it.
    along, down = (columns - middle[0]).astype(real), (rows - middle[1]).astype(real)
    at_cell = z + slope_x * (along - x) + slope_y * (down - y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at_cell += real(_GIVEN_BACK) * _blur(sums[2], sigma) / _blur(sums[0], sigma)
        total, by_square, _, squares = (_blur(s, _ALIKE) for s in sums)
        # Deviation times the unevenness of weights, their root mean square over their mean.
        scatter = np.sqrt(squares / total * by_square) / total
    return Fit(at_cell, scatter)


def _blur(values: F32, sigma: float) -> F32:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma), np.float32)
