"""Places where a surface is as round as a dome: candidates that a sphere is fitted to."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from roller_core.transforms import F64

I64 = npt.NDArray[np.int64]

#: Cells and steps of the search, and discs in which the surface is looked at, in radii.
_CELL, _STEP, _DISCS = 1 / 20, 1 / 8, (0.3, 0.5)
_LEAST_CELLS = 12
#: Curvatures that may be the sphere's, in units of its own; and of the two along the surface.
_CURVATURES, _MOST_UNEVEN = (0.25, 4.0), 3.0
#: A dome's cells lie within this share of the radius of it, at the median.
_MOST_MISS = 0.05
#: Candidates that are looked at, at most.
_MOST_PLACES = 12
#: Rounds of a robust fit; how sure it is of what no cell tells, by what all tell; and places that
#: are worked on together.
_ROUNDS, _LEAST_SURE, _AT_ONCE = 3, 1e-12, 256


def dome_places(local: F64, radius_m: float) -> list[F64]:
    """Tops of domes of about a radius.

    Parameters
    ----------
    local : ndarray of float64, shape (n, 3)
        Points: two coordinates along the surface and its height, metres.
    radius_m : float
        Radius that is looked for; a quarter to four times as much is found too.

    Returns
    -------
    list of ndarray of float64, shape (4,)
        Place and height of the top, metres, and curvature, 1/m; the best supported first.
    """
    cells = cell_medians(local, _CELL * radius_m)
    tree = cKDTree(cells[:, :2])
    step = _STEP * radius_m
    steps = np.unique(np.rint(cells[:, :2] / step).astype(np.int64), axis=0)
    places: F64 = steps.astype(np.float64) * step
    found: list[tuple[int, F64]] = []
    for disc in _DISCS:
        within = tree.query_ball_point(places, disc * radius_m)
        looked = [k for k, members in enumerate(within) if len(members) >= _LEAST_CELLS]
        for first in range(0, len(looked), _AT_ONCE):
            some = looked[first : first + _AT_ONCE]
            members = [np.array(within[k]) for k in some]
            tops_of = _dome_tops(cells, places[some], members, disc * radius_m, radius_m)
            found += [
                (len(own), top)
                for own, top in zip(members, tops_of, strict=True)
                if np.isfinite(top[0])
            ]
    found.sort(key=lambda item: -item[0])
    tops: list[F64] = []
    for _, top in found:
        if all(np.hypot(*(top[:2] - t[:2])) > 0.4 * radius_m for t in tops):
            tops.append(top)
    return tops[:_MOST_PLACES]


def cell_medians(local: F64, size_m: float) -> F64:
    """Median point height by square cells.

    Parameters
    ----------
    local : ndarray of float64, shape (n, 3)
        Two coordinates along the surface and the height, metres.
    size_m : float
        Edge of a cell.

    Returns
    -------
    ndarray of float64, shape (m, 3)
        Middle of each cell that holds points, and their median height.
    """
    keys, number = np.unique(
        np.floor(local[:, :2] / size_m).astype(np.int64), axis=0, return_inverse=True
    )
    number = number.reshape(-1)
    order = np.lexsort([local[:, 2], number])
    counts = np.bincount(number)
    starts = np.cumsum(counts) - counts
    heights = local[order, 2]
    middle = 0.5 * (heights[starts + (counts - 1) // 2] + heights[starts + counts // 2])
    return np.column_stack([(keys + 0.5) * size_m, middle])


def _dome_tops(cells: F64, places: F64, members: list[I64], disc_m: float, radius_m: float) -> F64:
    """Tops of the quadrics through cells around places; NaN where it is no dome of a likely bend.

    All at once: of thousands of places, one fit each would take a second.
    """
    counts = np.array([len(own) for own in members])
    there = np.arange(counts.max()) < counts[:, None]
    index = np.zeros(there.shape, np.int64)
    index[there] = np.concatenate(members)
    x, y = np.moveaxis((cells[index, :2] - places[:, None]) / disc_m, -1, 0)
    z = cells[index, 2]
    design = np.stack([np.ones_like(x), x, y, 0.5 * x * x, x * y, 0.5 * y * y], axis=-1)
    weight = there.astype(np.float64)
    each, low, high = np.arange(len(places)), (counts - 1) // 2, counts // 2
    for _ in range(_ROUNDS):
        weighted = np.swapaxes(design * weight[..., None], 1, 2)
        normal = weighted @ design
        # Of cells in a row the bend across is unknown: nought, as of the shortest solution.
        normal += _LEAST_SURE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(6)
        solution = np.linalg.solve(normal, weighted @ z[..., None])
        miss = np.where(there, np.abs(z - (design @ solution)[..., 0]), np.inf)
        in_order = np.sort(miss, axis=1)
        scale = np.maximum(0.5 * (in_order[each, low] + in_order[each, high]), 1e-9)
        weight = 1 / np.maximum(miss / (2 * scale[:, None]), 1)
    height, slope = solution[:, 0, 0], solution[:, 1:3, 0] / disc_m
    bend = -solution[:, [[3, 4], [4, 5]], 0] / disc_m**2
    least, most = np.linalg.eigvalsh(bend).T * radius_m
    dome = (scale <= _MOST_MISS * radius_m) & (least >= _CURVATURES[0])
    dome &= (most <= _CURVATURES[1]) & (most <= _MOST_UNEVEN * least)
    shift = np.full_like(slope, np.inf)
    shift[dome] = np.linalg.solve(bend[dome], slope[dome, :, None])[..., 0]
    dome &= np.hypot(*shift.T) <= 0.5 * disc_m
    tops = np.full((len(places), 4), np.nan)
    tops[dome, :2] = (places + shift)[dome]
    tops[dome, 2] = height[dome] + 0.5 * (slope[dome] * shift[dome]).sum(axis=1)
    tops[dome, 3] = 0.5 * (least + most)[dome] / radius_m
    return tops
