"""What of a window was scanned: a rectangle along the scan, which may lie askew in the map."""

from __future__ import annotations

import math

import cv2
import numpy as np

from roller_core.transforms import F64

from .height_map import Bools

#: Directions of a scan against the map's x that are tried; beyond them it is the other axis.
_TURNS = np.radians(np.arange(-45.0, 45.1, 0.5))
_UPRIGHT, _DIAGONAL = len(_TURNS) // 2, math.radians(30.0)
#: A rectangle lies askew if it is so much smaller than the upright one, its points reach over so
#: much of it, and its sides are so long, m: else its points are a feature's, not the roller's.
_SMALLER, _FILLED, _LEAST_SIDE_M = 0.97, 0.9, 5e-3


def outside_scan(known: Bools, step_m: float) -> Bools:
    """Cells beyond the smallest rectangle that holds all that were seen.

    It is upright, from the first to the last row and column with a point, unless the points
    clearly say that the scan goes askew.

    Parameters
    ----------
    known : ndarray of bool, shape (ny, nx)
        Cells with points; one at least.
    step_m : float
        Edge of a cell, metres.
    """
    rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
    out = np.ones(known.shape, bool)
    out[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = False
    turn, _, (low, high) = _smallest(known, step_m)
    if turn:
        row = np.arange(len(known))[:, None]
        # A cell's middle may lie half of it beyond.
        out[:, columns[0] : columns[-1] + 1] |= (row < low - 0.5) | (row > high + 0.5)
    return out


def turn_of(cells: Bools, step_m: float) -> float:
    """Direction of a scan of some cells against the map's x, rad; 0 unless it is clearly askew.

    Parameters
    ----------
    cells : ndarray of bool, shape (ny, nx)
        Those that were scanned.
    step_m : float
        Edge of a cell, metres.
    """
    if not cells.any():
        return 0.0
    turn, (along, across), _ = _smallest(cells, step_m)
    # Near the diagonal the map's x says little of the direction: a scan is longer than wide.
    if abs(turn) > _DIAGONAL and across > along:
        turn -= math.copysign(math.pi / 2, turn)
    return turn


def _smallest(known: Bools, step_m: float) -> tuple[float, F64, F64]:
    """Turn of the smallest rectangle, and its sides along and across, in cells.

    And its first and last rows, (2, n), from the first column with a point to the last.
    """
    columns = np.nonzero(known.any(axis=0))[0]
    at = np.arange(columns[0], columns[-1] + 1)
    # First and last of each column: all that an outline can go through.
    ends = known.argmax(axis=0), len(known) - 1 - known[::-1].argmax(axis=0)
    corners = np.concatenate([np.stack([columns, end[columns]], axis=-1) for end in ends])
    hull = cv2.convexHull(corners.astype(np.int32))
    low, high, sides = _rectangles(hull[:, 0].astype(np.float64), at)
    areas = np.maximum(high - low, 0.0).sum(axis=1)
    best = int(np.argmin(areas))
    if (
        areas[best] > _SMALLER * areas[_UPRIGHT]
        or cv2.contourArea(hull) < _FILLED * areas[best]
        or sides[best].min() * step_m < _LEAST_SIDE_M
    ):
        best = _UPRIGHT
    return float(_TURNS[best]), sides[best], np.stack([low[best], high[best]])


def _rectangles(hull: F64, columns: F64) -> tuple[F64, F64, F64]:
    """By turn and column the first and last row of the rectangle around a hull (n, 2), x and y.

    Rows are fractions, none where the last is before the first. And each one's sides along and
    across.
    """
    c, s = np.cos(_TURNS), np.sin(_TURNS)
    along, across = hull @ np.stack([c, s]), hull @ np.stack([-s, c])
    u0, u1, v0, v1 = (
        end[:, None] for end in (along.min(0), along.max(0), across.min(0), across.max(0))
    )
    sides = np.concatenate([u1 - u0, v1 - v0], axis=1)
    c, s = c[:, None], s[:, None]
    low, high = (v0 + columns * s) / c, (v1 + columns * s) / c
    with np.errstate(divide="ignore", invalid="ignore"):
        begin, end = (u0 - columns * c) / s, (u1 - columns * c) / s
    upright = s == 0
    low = np.where(upright, low, np.maximum(low, np.minimum(begin, end)))
    high = np.where(upright, high, np.minimum(high, np.maximum(begin, end)))
    return low, high, sides
