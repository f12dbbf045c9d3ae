"""Gaps: where they are, and bounds for the surface over them."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import Delaunay, QhullError

from . import _kernels
from .height_map import F32, OUTSIDE, Bools, HeightMap

#: Where no cell so near is measured is a gap, and measured cells this far from one may be corners
#: of its triangles, cells.
_NEAR, _SHORE = 2, 1
#: Gaps of this width, m, hide what is as large as findings.
WIDE_GAP_M = 1e-3


def hold_gaps(height_m: F32, measured_m: F32, outside: Bools) -> None:
    """Keep the completed surface between the measured heights around, in place.

    Cells of a gap stay within the heights of the three measured cells whose triangle (Delaunay's)
    they lie in. A surface that bends little swings beyond steep walls, and would err more there
    than linear interpolation.

    Parameters
    ----------
    height_m : ndarray of float32, shape (ny, nx)
        The completed surface, metres.
    measured_m : ndarray of float32, shape (ny, nx)
        Measured cells, NaN elsewhere.
    outside : ndarray of bool, shape (ny, nx)
        Cells beyond the scan, which are left as they are.
    """
    known = np.isfinite(measured_m)
    gap = ~(grown(known, _NEAR) | outside)
    shore = known & grown(gap, _NEAR + _SHORE)
    # Of cells side by side every other one does: triangles take time.
    even = shore & (np.add.outer(*map(np.arange, shore.shape)) % 2 == 0)
    corners = np.argwhere(even | (shore & ~grown(even, 1)))
    try:
        triangles = Delaunay(corners)
    except (QhullError, ValueError):  # None, fewer than three, or all on one line.
        return
    sides = corners[triangles.simplices]
    heights = measured_m[tuple(corners.T)][triangles.simplices]
    # Not `find_simplex`: between corners on a grid it may search all triangles for each cell.
    low, high = np.full((2, *known.shape), [[[np.inf]], [[-np.inf]]], np.float32)
    _kernels._paint(sides, heights, low, high)
    held = gap & (low <= high)
    np.clip(height_m, low, high, out=height_m, where=held)


def inner_gaps(height_map: HeightMap, least_m: float) -> Bools:
    """Cells of gaps that are wide and lie within what is known, shape (ny, nx).

    Parameters
    ----------
    height_map : HeightMap
        The map.
    least_m : float
        Least width, m.
    """
    bare = ~height_map.known
    size = max(1, round(least_m / height_map.step_m))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    wide = cv2.morphologyEx(bare.view(np.uint8), cv2.MORPH_OPEN, disc) > 0
    # What hangs together with the map's end isn't within.
    around = np.pad(bare, 1, constant_values=True).view(np.uint8)
    beyond = np.pad(height_map.state == OUTSIDE, 1, constant_values=True)
    _, labels = cv2.connectedComponents(around)
    outer = np.isin(labels, np.unique(labels[beyond]))
    return np.asarray(wide & ~outer[1:-1, 1:-1])


def grown(cells: Bools, by: int) -> Bools:
    """Cells and those so near to them, corners included."""
    size = 2 * by + 1
    return cv2.dilate(cells.view(np.uint8), np.ones((size, size), np.uint8)) > 0
