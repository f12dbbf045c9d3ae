"""A reference given as heights over a grid, and its alignment to a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import F32, MEASURED, Bools, HeightMap

from .nominal import tukey
from .reference import Alignment, Comparison, ReferenceError, rms_robust

NAMES = ("x", "y", "z", "rx", "ry", "rz")
_ROUNDS = 6
#: Cells that an alignment uses at most, and fewest.
_MOST_CELLS, _LEAST_CELLS = 40_000, 200
#: A direction is refined if it moves the surface by less than this when chance has its way, m;
#: one in so many cells says something of its own.
_SURE_M, _SHARED = 2e-5, 50.0
#: The robot's pose isn't off by more than this, m, and a reference leaves less than this, m.
_FARTHEST_M, _WORST_M = 2e-3, 5e-4
#: Slopes steeper than this don't say where a wall is: the skin rounds it.
_STEEPEST = 1.0


@dataclass(frozen=True)
class Field:
    """Heights over a grid in the frame of a map."""

    #: Centres of the cells. Shapes (nx,), (ny,).
    x_m: F64
    y_m: F64
    #: NaN where there is none. Shape (ny, nx).
    height_m: F32
    sigma_m: F32

    def sample(self, x: F64, y: F64) -> tuple[F64, F64]:
        """Height and uncertainty at places, linear; NaN outside."""
        step = (self.x_m[-1] - self.x_m[0]) / max(len(self.x_m) - 1, 1)
        at = np.stack([(y - self.y_m[0]) / step, (x - self.x_m[0]) / step])
        inside = (at >= 0).all(axis=0)
        inside &= (at[0] <= len(self.y_m) - 1) & (at[1] <= len(self.x_m) - 1)
        height, sigma = (
            ndimage.map_coordinates(grid, at, order=1, mode="nearest", output=np.float64)
            for grid in (self.height_m, self.sigma_m)
        )
        return np.where(inside, height, np.nan), np.where(inside, sigma, np.nan)


def compare_field(
    field: Field, height_map: HeightMap, name: str, masked: Bools | None = None
) -> Comparison:
    """Lay a field on a map, refined in what the geometry determines, and compare.

    Raises
    ------
    ReferenceError
        If they don't overlap, or lie further apart than a pose can be off.
    """
    x, y = np.meshgrid(height_map.x_m, height_map.y_m)
    used = (height_map.state == MEASURED) & np.isfinite(height_map.height_m)
    if masked is not None:
        used &= ~masked
    overlap = used & np.isfinite(field.sample(x, y)[0])
    if overlap.sum() < max(_LEAST_CELLS, 0.02 * used.sum()):
        raise ReferenceError(
            f"reference {name}: it lies beside the scan: {int(overlap.sum())} of "
            f"{int(used.sum())} measured cells are on it; check its frame and unit"
        )
    rows, columns = np.nonzero(overlap)
    stride = max(1, len(rows) // _MOST_CELLS)
    rows, columns = rows[::stride], columns[::stride]
    px, py = height_map.x_m[columns], height_map.y_m[rows]
    motion, refined = _align(field, px, py, height_map.height_m[rows, columns].astype(np.float64))
    centre = np.array([px.mean(), py.mean()])
    height, sigma = _moved(field, motion, centre, x, y)
    deviation = (height_map.height_m - height).astype(np.float32)
    residual = deviation[overlap]
    left = rms_robust(residual)
    if not left < _WORST_M or not np.linalg.norm(motion[:3]) < _FARTHEST_M:
        raise ReferenceError(
            f"reference {name}: it lies {np.linalg.norm(motion[:3]) * 1e3:.2g} mm beside where the "
            f"pose puts it and {left * 1e6:.0f} µm off the scan; is it this part, in this place?"
        )
    return Comparison(
        deviation,
        np.nan_to_num(sigma, nan=0.0).astype(np.float32),
        Alignment(name, _in_base(motion, centre, height_map), refined, left, int(overlap.sum())),
        by_pose="z" not in refined,
    )


def _moved(field: Field, motion: F64, centre: F64, x: F64, y: F64) -> tuple[F64, F64]:
    """Height and uncertainty of the field moved by small dx, dy, dz, rx, ry, rz."""
    dx, dy, dz, rx, ry, rz = motion
    u, v = x - centre[0], y - centre[1]
    height, sigma = field.sample(x - dx + rz * v, y - dy - rz * u)
    return height + dz + rx * v - ry * u, sigma


def _align(field: Field, x: F64, y: F64, z: F64) -> tuple[F64, tuple[str, ...]]:
    """Robust small motion of the field to points, in the directions that they determine."""
    centre = np.array([x.mean(), y.mean()])
    arm = max(float(np.hypot(x - centre[0], y - centre[1]).max()), 1e-6)
    # Turns in units of the way that they move the farthest point.
    scale = np.array([1, 1, 1, 1 / arm, 1 / arm, 1 / arm])
    motion, determined = np.zeros(6), np.zeros(6)
    e = 1e-4
    for _ in range(_ROUNDS):
        height, _ = _moved(field, motion, centre, x, y)
        gx, gy = (
            (_moved(field, motion, centre, x + i * e, y + j * e)[0]
             - _moved(field, motion, centre, x - i * e, y - j * e)[0]) / (2 * e)
            for i, j in ((1, 0), (0, 1))
        )  # fmt: skip
        away = z - height
        good = np.isfinite(away) & np.isfinite(gx) & np.isfinite(gy)
        good &= np.hypot(gx, gy) < _STEEPEST
        if good.sum() < _LEAST_CELLS:
            break
        u, v = x - centre[0], y - centre[1]
        columns = np.stack([-gx, -gy, np.ones_like(u), v, -u, gx * v - gy * u])
        columns = columns[:, good] * scale[:, None]
        residual = away[good] - np.median(away[good])
        weight = tukey(residual)
        matrix = columns * weight @ columns.T
        values, vectors = np.linalg.eigh(matrix)
        noise = max(rms_robust(residual), 5e-6)
        sure = noise * np.sqrt(_SHARED / np.maximum(values, 1e-12)) < _SURE_M
        free = vectors[:, sure]
        pull = free.T @ (columns * weight @ away[good])
        motion = motion + scale * (free @ (pull / values[sure]))
        determined = (free**2).sum(axis=1)
        if np.linalg.norm(motion[:3]) > 2 * _FARTHEST_M:
            break
    return motion, tuple(n for n, d in zip(NAMES, determined, strict=True) if d > 0.5)


def _in_base(motion: F64, centre: F64, height_map: HeightMap) -> F64:
    """The motion as a matrix in base."""
    dx, dy, dz, rx, ry, rz = motion
    local = np.eye(4)
    local[:3, :3] += [[0, -rz, ry], [rz, 0, -rx], [-ry, rx, 0]]
    local[:3, 3] = [dx + rz * centre[1], dy - rz * centre[0], dz - rx * centre[1] + ry * centre[0]]
    base = height_map.base_from_map
    return np.asarray(base @ local @ np.linalg.inv(base))
