"""Places where a surface is as round as a dome: candidates that a sphere is fitted to."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from roller_core.transforms import F64

#: Cells and steps of the search, and discs in which the surface is looked at, in radii.
_CELL, _STEP, _DISCS = 1 / 20, 1 / 8, (0.3, 0.5)
_LEAST_CELLS = 12
#: Curvatures that may be the sphere's, in units of its own; and of the two along the surface.
_CURVATURES, _MOST_UNEVEN = (0.25, 4.0), 3.0
#: A dome's cells lie within this share of the radius of it, at the median.
_MOST_MISS = 0.05
#: Candidates that are looked at, at most.
_MOST_PLACES = 12


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
    places = np.unique(np.rint(cells[:, :2] / step).astype(np.int64), axis=0) * step
    found: list[tuple[int, F64]] = []
    for disc in _DISCS:
        for place, members in zip(
            places, tree.query_ball_point(places, disc * radius_m), strict=True
        ):
            if len(members) >= _LEAST_CELLS:
                top = _dome_top(cells[members], place, disc * radius_m, radius_m)
                if top is not None:
                    found.append((len(members), top))
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


def _dome_top(cells: F64, place: F64, disc_m: float, radius_m: float) -> F64 | None:
    """Top of the quadric through cells, if it is a dome of a likely curvature."""
    x, y = ((cells[:, :2] - place) / disc_m).T
    design = np.column_stack([np.ones(len(x)), x, y, 0.5 * x * x, x * y, 0.5 * y * y])
    weight = np.ones(len(x))
    for _ in range(3):
        solution = np.linalg.lstsq(design * weight[:, None], cells[:, 2] * weight, rcond=None)[0]
        miss = np.abs(cells[:, 2] - design @ solution)
        scale = max(float(np.median(miss)), 1e-9)
        weight = np.sqrt(1 / np.maximum(miss / (2 * scale), 1))
    if scale > _MOST_MISS * radius_m:
        return None
    bend = -np.array([[solution[3], solution[4]], [solution[4], solution[5]]]) / disc_m**2
    low, high = np.linalg.eigvalsh(bend) * radius_m
    if low < _CURVATURES[0] or high > _CURVATURES[1] or high > _MOST_UNEVEN * low:
        return None
    shift = np.linalg.solve(bend, solution[1:3] / disc_m)
    if np.hypot(*shift) > 0.5 * disc_m:
        return None
    height = float(solution[0] + 0.5 * (solution[1:3] / disc_m) @ shift)
    return np.array([*(place + shift), height, 0.5 * (low + high) / radius_m])
