"""Points follow the lines around them; lines that are surer become points themselves."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from roller_core.transforms import F64
from roller_emvs.evidence import Relief
from roller_emvs.rays import F32

from . import _place_kernels as kernels
from .fit import I64, ROW_STEP
from .line_points import LinePoints

#: A point within this of a line, along the parallax, is of the same feature, px.
_SAME_PX = 1
#: Correlation of what a line and the points around it err by: they are of the same events.
#: On the virtual cell's gauges 0.6-0.9.
_ALIKE = 0.7
#: Neighbourhood over which points err alike, px, and what that changes over it, m.
_SHARED_PX, _CHANGES_M = 4.0, 3e-5
#: The foot and the top of a wall err apart: what points are moved by goes linearly along the row,
#: held back as if lines lay so far around, px.
_STIFF_PX = 1.0


def widen_sigma(found: Relief, lines: LinePoints, sigma: F64) -> Relief:
    """Points as unsure as the lines around are for what both can't know.

    Parameters
    ----------
    found : Relief
        Points.
    lines : LinePoints
        Lines, n of them.
    sigma : ndarray of float64, shape (n,)
        What each line is unsure of besides, in offset.
    """
    counts, shape = np.stack([np.ones(len(sigma)), sigma**2]), found.surfaces[0].shape
    around = _around(lines, counts, shape, found.row, found.column)
    unsure = found.sigma.copy()
    kernels._add_variance(found.row, found.column, around, unsure)
    return replace(found, sigma=unsure)


def move_points(found: Relief, lines: LinePoints, offset: F64, sigma: F64, per_m: float) -> Relief:
    """Points moved as the lines around say, as far as those are surer.

    What a neighbourhood's height is off by, it is off by at the line too. Where lines say
    different things, as at the foot and the top of a wall, points are as unsure as those differ.

    Parameters
    ----------
    found : Relief
        Points, and the surface by polarity that the lines were fitted around.
    lines : LinePoints
        Lines, n of them.
    offset, sigma : ndarray of float64, shape (n,)
        Of the lines, without their drift, and how unsure they are.
    per_m : float
        From metres to the offset.
    """
    shape = found.surfaces[0].shape
    row, column = _pixels(lines, shape)
    before = np.stack([surface[row, column] for surface in found.surfaces])
    move = offset - before[lines.polarity, np.arange(len(row))]
    # A line may lie just beyond the surface that it was fitted from: it moves nothing.
    known = np.isfinite(move)
    move, weight = np.where(known, move, 0.0), np.where(known, 1.0 / sigma**2, 0.0)
    # From the grid's middle, so that float32 tells squares of places apart.
    middle = 0.5 * shape[1]
    x, by = lines.column - middle, weight * move
    sums = np.stack([weight, by, by * move, weight * x, weight * x**2, by * x])
    around = _around(lines, sums, shape, found.row, found.column)
    # A line in the middle of the neighbourhood counts in full, with what height changes over it.
    peak, floor = np.sqrt(2 * np.pi) * _SHARED_PX / kernels.GRID_PX, (_CHANGES_M * per_m) ** 2
    limits = middle, _STIFF_PX**2, peak, floor
    followed, unsure = np.empty(len(found.row)), np.empty(len(found.row), np.float32)
    kernels._move(
        found.row, found.column, found.offset, found.sigma, around, limits, followed, unsure
    )
    return replace(found, offset=followed, sigma=unsure)


def _pixels(lines: LinePoints, shape: tuple[int, ...]) -> tuple[I64, I64]:
    """Rows and columns of the pixels that lines lie in."""
    column = np.rint(lines.column).astype(np.int64).clip(0, shape[1] - 1)
    return lines.row.astype(np.int64), column


def _around(
    lines: LinePoints, values: F64, shape: tuple[int, ...], row: np.ndarray, column: np.ndarray
) -> F32:
    """Values of lines, shape (values, n), over a neighbourhood, on a grid of `GRID_PX`.

    0 but for what lies around the places `row`, `column`.
    """
    rows, columns = (-(-size // kernels.GRID_PX) for size in shape)
    sums = np.zeros((rows, columns, len(values)), np.float32)
    kernels._add_lines(*_pixels(lines, shape), values, sums)
    along, down = np.sqrt((_SHARED_PX / kernels.GRID_PX) ** 2 - np.array(kernels.WIDER))
    around = np.zeros_like(sums)
    if len(row):
        box = _box_near(row, down), _box_near(column, along)
        around[box] = cv2.GaussianBlur(sums[box], (0, 0), sigmaX=along, sigmaY=down)
    return around


def _box_near(place: np.ndarray, sigma: float) -> slice:
    """Cells of `GRID_PX` that a Gaussian of them takes in at places, between two cells each."""
    first, last = (int(end) // kernels.GRID_PX for end in (place.min(), place.max()))
    reach = int(4 * sigma) + 2
    return slice(max(first - reach, 0), last + reach + 2)


def add_lines(found: Relief, lines: LinePoints, offset: F64, sigma: F64, tilt: F64) -> Relief:
    """Points, and lines that are surer than those beside them.

    A line's height is the mean of both by what each is sure of. The points beside it stay: they
    have been moved by it, err hardly more, and without them edges would be thinner.

    Parameters
    ----------
    found : Relief
        Points.
    lines : LinePoints
        Lines, n of them.
    offset, sigma, tilt : ndarray of float64, shape (n,)
        Of the lines, without their drift; how unsure they are; and their columns by row.
    """
    shape, room = found.surfaces[0].shape, ROW_STEP * len(offset)
    point = np.full(shape, -1, np.int32)
    point[found.row, found.column] = np.arange(len(found.row), dtype=np.int32)
    line, row, other = (np.empty(room, np.int64) for _ in range(3))
    column, sure = np.empty(room), np.empty(room + 1, np.float32)
    count = kernels._surer(
        lines.row.astype(np.int64), lines.column, tilt, sigma, ROW_STEP, _SAME_PX, point,
        found.sigma, found.confidence, np.full(shape, np.inf), line, row, column, other, sure,
    )  # fmt: skip
    line, row, column, other = line[:count], row[:count], column[:count], other[:count]
    own, best = sigma[line], found.sigma[other].astype(np.float64)
    both = _ALIKE * own * best
    share = np.minimum((best**2 - both) / (own**2 + best**2 - 2 * both), 1.0)
    left = (share * own) ** 2 + ((1 - share) * best) ** 2 + 2 * share * (1 - share) * both
    height = share * offset[line] + (1 - share) * found.offset[other]
    return replace(
        found,
        row=np.concatenate([found.row, row]),
        column=np.concatenate([found.column, column]),
        offset=np.concatenate([found.offset, height]),
        confidence=np.concatenate([found.confidence, sure[:count]]),
        sigma=np.concatenate([found.sigma, np.sqrt(left)]).astype(np.float32),
        agreed=np.concatenate([found.agreed, np.ones(count)]).astype(np.float32),
        one_sided=np.concatenate([found.one_sided, found.one_sided[other]]),
    )
