"""Datum planes: fitted robustly, to measured cells only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import Bools, HeightMap
from roller_inspect.references.nominal import tukey

#: Fewest measured cells of a plane.
LEAST_CELLS = 30
#: Cells in blocks of this edge share their errors, m.
_BLOCK_M = 1e-3
#: What a whole region's errors have in common, in part of a cell's σ.
_COMMON = 1 / 3
_ROUNDS = 10


@dataclass(frozen=True)
class Datum:
    """A plane z = height + slope_x (x − cx) + slope_y (y − cy) in the map's frame."""

    #: cx, cy: mean place of its cells, metres.
    centre_m: tuple[float, float]
    #: There, metres.
    height_m: float
    #: Metres a metre.
    slope_x: float
    slope_y: float
    #: Of height and slopes, k = 1, from blocks that repeat each other. Shape (3, 3).
    covariance: F64
    #: Standard uncertainty that all of it shares, metres.
    common_m: float
    #: Measured cells.
    cells: int

    @property
    def normal(self) -> F64:
        """Its normal of length 1, upwards. Shape (3,)."""
        normal = np.array([-self.slope_x, -self.slope_y, 1.0])
        return np.asarray(normal / np.linalg.norm(normal))

    def at(self, x: F64 | float, y: F64 | float) -> F64:
        """Height of the plane at places."""
        cx, cy = self.centre_m
        return np.asarray(self.height_m + self.slope_x * (x - cx) + self.slope_y * (y - cy))

    def standard_uncertainty(self, x: float, y: float) -> float:
        """Of its height at a place, without what is common, k = 1."""
        row = np.array([1.0, x - self.centre_m[0], y - self.centre_m[1]])
        return float(np.sqrt(max(row @ self.covariance @ row, 0.0)))


def datum_plane(height_map: HeightMap, region: Bools) -> Datum | None:
    """Plane through the measured cells of a region; None with too few.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    region : ndarray of bool, shape (ny, nx)
        Cells of the datum.
    """
    used = region & height_map.measured()
    rows, columns = np.nonzero(used)
    if len(rows) < LEAST_CELLS:
        return None
    x, y = height_map.x_m[columns], height_map.y_m[rows]
    z = height_map.height_m[rows, columns].astype(np.float64)
    cx, cy = float(x.mean()), float(y.mean())
    basis = np.column_stack([np.ones_like(x), x - cx, y - cy])
    # A tiny ridge, of µm: cells on a line determine no slope across it.
    ridge = np.diag([0.0, 1.0, 1.0]) * len(z) * 1e-12
    weight, found = np.ones(len(z)), np.array([np.median(z), 0.0, 0.0])
    for _ in range(_ROUNDS):
        found = np.linalg.solve(basis.T * weight @ basis + ridge, basis.T * weight @ z)
        weight = tukey(z - basis @ found)
    sigma = float(np.median(height_map.sigma_m[used]))
    return Datum(
        (cx, cy),
        float(found[0]),
        float(found[1]),
        float(found[2]),
        _covariance(basis, z - basis @ found, weight, sigma),
        _COMMON * sigma,
        len(rows),
    )


def _covariance(basis: F64, residual: F64, weight: F64, sigma: float) -> F64:
    """Covariance of a fit whose errors are alike within blocks."""
    block = np.floor((basis[:, 1:] - basis[:, 1:].min(axis=0)) / _BLOCK_M).astype(np.int64)
    _, number = np.unique(block, axis=0, return_inverse=True)
    number = number.ravel()
    total = np.bincount(number, weight)
    full = total > 0.2 * np.median(total[total > 0])
    mean = np.bincount(number, weight * residual)[full] / total[full]
    places = np.column_stack(
        [np.bincount(number, weight * column)[full] / total[full] for column in basis.T]
    )
    # With few blocks their own spread says little.
    blocks = len(mean)
    spread = float(mean @ mean + 3 * (0.5 * sigma) ** 2) / max(blocks + 3 - 3, 1)
    normal = places.T @ places + np.diag([0.0, _BLOCK_M**2, _BLOCK_M**2]) / 4
    return np.asarray(spread * np.linalg.inv(normal))
