"""The surface between measured cells.

What is minimised over heights h with measured cells z::

    sum w Huber((h - z) / σ; 2) + sum ρ |D²h|² / B² + sum τ s² / sqrt(1 + s²),  s = slope / 0.1

The second term bends the surface little, and less still where nothing was measured (ρ = 1): no
event, no change of shading, the surface goes on as it was. The third lets steep walls end. A cell's
height is that of its points' mean place: on a slope it is moved to the cell's middle.
"""

from __future__ import annotations

import cv2
import numpy as np

from . import _kernels, _multigrid
from .height_map import F32
from .nearest import nearest_known

#: Cell that the weights are for, m; tuned on the virtual cell, and checked on another simulator.
_CELL_M = 1.27e-4
#: B, and τ of the slopes with the slope that counts as one.
_BEND_M, _SLOPE_WEIGHT, _SLOPE = 50e-6, 0.03, 0.1
#: ρ of measured cells: they may bend.
_FREE = 0.2
#: Anchors' σ is at most this, m: that of lone edges covers more than their scatter, and with softer
#: anchors steep walls tilt the flats beside them. And at least.
_MOST_SIGMA_M, _LEAST_SIGMA_M = 30e-6, 1e-6
#: Beyond so many σ an anchor pulls no harder.
_HUBER = np.float32(2.0)
#: Grids from coarse to fine: how much coarser, rounds of reweighting, and the solver's steps. Dense
#: cells are there after one step, sparse ones take all.
_GRIDS = ((8, 4, 3), (4, 3, 2), (2, 2, 2), (1, 2, 2))
#: Slope from which on heights are moved no further: it may be an error's.
_STEEPEST = 1.0
#: The solver's last step is the one before which a cell's squared error is this, in σ².
_ENOUGH = 1e-3
#: A cell pulls no harder than this times what bends one: it doesn't move, and steps go on.
_HARDEST = 1e4
#: Levels of the solver, the finest included.
_LEVELS = 8


def complete_surface(height_m: F32, sigma_m: F32, step_m: float, place: F32 | None = None) -> F32:
    """Heights of all cells from the measured ones.

    Parameters
    ----------
    height_m, sigma_m : ndarray of float32, shape (ny, nx)
        Measured cells and their standard uncertainty, NaN elsewhere.
    step_m : float
        Edge of a cell, metres.
    place : ndarray of float32, shape (2, ny, nx), optional
        Of which place the heights are, see `Cells`; else of the cells' middles.

    Returns
    -------
    ndarray of float32, shape (ny, nx)
        Metres.
    """
    known = np.isfinite(height_m)
    if not known.any():
        return height_m.copy()
    level = float(np.median(height_m[known]))
    z = np.where(known, height_m - np.float32(level), np.float32(0))
    weight = np.where(known, np.float32((step_m / _CELL_M) ** 2), np.float32(0))
    bounds = np.float32(_LEAST_SIGMA_M), np.float32(_MOST_SIGMA_M)
    sigma = np.where(known, np.clip(sigma_m, *bounds), np.float32(1))
    # Of each grid the weights of its cells, and their sums of heights and uncertainties.
    grids = [np.stack([weight, weight * z, weight * sigma])]
    while 2 ** len(grids) <= _GRIDS[0][0]:
        grids.append(_coarser(grids[-1]))
    found: F32 | None = None
    for factor, rounds, steps in _GRIDS:
        wc, heights, spreads = grids[factor.bit_length() - 1]
        share = 1 / np.maximum(wc, np.float32(1e-12))
        zc, sc = heights * share, np.where(wc > 0, spreads * share, np.float32(1))
        if found is None:
            start = zc.ravel()[nearest_known(wc > 0)]
        else:
            start = _finer(found, zc.shape)
        at = place if factor == 1 else None
        found = _solve(zc, wc, sc, start, step_m * factor, rounds, steps, at)
    assert found is not None
    return np.asarray(found + np.float32(level), np.float32)


def at_middles(surface_m: F32, height_m: F32, place: F32, step_m: float) -> F32:
    """Measured heights at the middles of their cells, along the surface.

    Parameters
    ----------
    surface_m, height_m : ndarray of float32, shape (ny, nx)
        The surface, and the heights measured at `place`, NaN where there is none; metres.
    place : ndarray of float32, shape (2, ny, nx)
        See `Cells`.
    step_m : float
        Edge of a cell, metres.
    """
    out = np.empty_like(height_m)
    _kernels._to_middles(surface_m, height_m, place, np.float32(_STEEPEST * step_m), out)
    return out


def _coarser(values: F32) -> F32:
    """Sums over two by two cells, shape (..., ny, nx) halved, rounded up."""
    pad = [(0, 0)] * (values.ndim - 2) + [(0, n % 2) for n in values.shape[-2:]]
    rows = np.pad(values, pad) if values.shape[-1] % 2 or values.shape[-2] % 2 else values
    pairs = rows[..., ::2, :] + rows[..., 1::2, :]
    return np.asarray(pairs[..., ::2] + pairs[..., 1::2], np.float32)


def _finer(values: F32, shape: tuple[int, ...]) -> F32:
    """The double of a grid, cropped to a shape."""
    double = (2 * values.shape[1], 2 * values.shape[0])
    finer = cv2.resize(values, double, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(finer[: shape[0], : shape[1]], np.float32)


def _solve(
    z: F32,
    weight: F32,
    sigma: F32,
    start: F32,
    step_m: float,
    rounds: int,
    steps: int,
    place: F32 | None,
) -> F32:
    """Reweighted least squares on one grid."""
    known = weight > 0
    stiff = (_CELL_M / step_m) ** 2 / _BEND_M**2
    h = np.ascontiguousarray(start)
    ny, nx = h.shape
    shapes = [(-(-ny // 2**k), -(-nx // 2**k)) for k in range(_LEVELS)]

    def cells(cut_y: int = 0, cut_x: int = 0) -> tuple[F32, ...]:
        return tuple(np.empty((my - cut_y, mx - cut_x), np.float32) for my, mx in shapes)

    levels = tuple(zip(cells(), cells(), cells(cut_x=1), cells(cut_y=1), cells(), strict=True))
    pull, bend, tie_x, tie_y, _ = levels[0]
    scratch = cells(), cells(), cells(), cells(), np.empty_like(h), np.empty((3, nx + 2), h.dtype)
    pulled = np.empty_like(h)
    bend[:] = np.where(known, np.float32(_FREE * stiff), np.float32(stiff))
    # Of slopes as of bends: a sum over cells of _CELL_M, whatever the grid.
    tie = np.float32((step_m / _CELL_M) ** 2 * _SLOPE_WEIGHT / (step_m * _SLOPE) ** 2)
    slope = np.float32(1 / (step_m * _SLOPE))
    hardest = np.float32(_HARDEST * stiff)
    enough = np.float32(_ENOUGH * np.count_nonzero(known))
    for _ in range(rounds):
        anchors = z if place is None else at_middles(h, z, place, step_m)
        _multigrid._weigh(
            h, anchors, weight, sigma, _HUBER, hardest, tie, slope, pull, pulled, tie_x, tie_y
        )
        _multigrid.solve(h, pulled, levels, *scratch, enough, steps)
    return h
