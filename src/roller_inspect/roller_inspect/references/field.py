"""A reference given as heights over a grid, and its alignment to a scan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import F32, Bools, HeightMap

from .nominal import tukey
from .reference import Alignment, Comparison, ReferenceError, rms_robust

NAMES = ("x", "y", "z", "rx", "ry", "rz")
_ROUNDS = 6
#: Cells that an alignment uses at most, and fewest.
_MOST_CELLS, _LEAST_CELLS = 40_000, 200
#: A direction is refined if it moves the surface by less than this when chance has its way, m;
#: one in so many cells says something of its own.
_SURE_M, _SHARED = 2e-5, 50.0
#: The robot's pose isn't off by more than this, m, nor turned by more than this, rad, and a
#: reference leaves less than this, m.
_FARTHEST_M, _MOST_TURN, _WORST_M = 2e-3, 0.06, 5e-4
#: Slopes steeper than this don't say where a wall is: the skin rounds it.
_STEEPEST = 1.0
#: Where more than this share of what is left is so many times the median, the reference is looked
#: at from afar: blurred by a Gaussian of this deviation, m, refined in what is as sure as this, m,
#: by residuals up to this, m. What comes of it counts if it leaves less by this factor.
_MANY, _TIMES_NOISE, _BLUR_M, _FROM_AFAR_M, _BETTER = 0.01, 6.0, 7e-4, (3e-4, 1e-4), 0.95


@dataclass(frozen=True)
class Field:
    """Heights over a grid in the frame of a map."""

    #: Centres of the cells. Shapes (nx,), (ny,).
    x_m: F64
    y_m: F64
    #: NaN where there is none. Shape (ny, nx).
    height_m: F32
    sigma_m: F32

    def blurred(self, sigma_m: float) -> Field:
        """Heights smoothed by a Gaussian; gaps stay."""
        step = (self.x_m[-1] - self.x_m[0]) / max(len(self.x_m) - 1, 1)
        there = np.isfinite(self.height_m)
        height, share = (
            ndimage.gaussian_filter(grid.astype(np.float32), sigma_m / step)
            for grid in (np.nan_to_num(self.height_m), there)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            return replace(self, height_m=np.where(there, height / share, np.float32(np.nan)))

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
    used = height_map.measured(masked)
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
    away_m, turn = float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))
    if not (left < _WORST_M and away_m < _FARTHEST_M and turn < _MOST_TURN):
        turned = f", turned by {np.degrees(turn):.1f}°," if turn >= _MOST_TURN else ""
        raise ReferenceError(
            f"reference {name}: it lies {away_m * 1e3:.2g} mm beside where the pose puts it"
            f"{turned} and {left * 1e6:.0f} µm off the scan; is it this part, in this place?"
        )
    return Comparison(
        deviation,
        np.nan_to_num(sigma, nan=0.0).astype(np.float32),
        Alignment(
            name,
            _in_base(motion, centre, height_map),
            refined,
            left,
            int(overlap.sum()),
            height_map.in_base(centre[0], centre[1], 0.0),
        ),
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
    motion, refined = _fit(field, x, y, z, np.zeros(6))
    left = _left(field, motion, centre, x, y, z)
    if np.mean(left > _TIMES_NOISE * np.median(left)) > _MANY:
        # Walls that lie beside each other don't pull: a blurred field shows them from afar.
        start, _ = _fit(field.blurred(_BLUR_M), x, y, z, motion, *_FROM_AFAR_M)
        nearer, better = _fit(field, x, y, z, start)
        most = _TIMES_NOISE * np.median(left)
        after = _left(field, nearer, centre, x, y, z)
        if np.minimum(after, most).mean() < _BETTER * np.minimum(left, most).mean():
            return nearer, better
    return motion, refined


def _left(field: Field, motion: F64, centre: F64, x: F64, y: F64, z: F64) -> F64:
    """What a motion leaves, without sign; of places beside the field the median."""
    away = np.abs(z - _moved(field, motion, centre, x, y)[0])
    return np.where(np.isfinite(away), away, np.nanmedian(away))


def _fit(
    field: Field, x: F64, y: F64, z: F64, start: F64, sure_m: float = _SURE_M, spread_m: float = 0.0
) -> tuple[F64, tuple[str, ...]]:
    """Motion by steps from a first one; residuals up to a spread count in full."""
    centre = np.array([x.mean(), y.mean()])
    arm = max(float(np.hypot(x - centre[0], y - centre[1]).max()), 1e-6)
    # Turns in units of the way that they move the farthest point.
    scale = np.array([1, 1, 1, 1 / arm, 1 / arm, 1 / arm])
    motion, determined = start.copy(), np.zeros(6)
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
        # A plane first: a reference that leans would look like noise.
        level = _without_plane(away[good], columns[2:5])
        weight = tukey(level, spread_m)
        matrix = columns * weight @ columns.T
        values, vectors = np.linalg.eigh(matrix)
        noise = max(rms_robust(level), 5e-6)
        sure = noise * np.sqrt(_SHARED / np.maximum(values, 1e-12)) < sure_m
        free = vectors[:, sure]
        pull = free.T @ (columns * weight @ away[good])
        motion = motion + scale * (free @ (pull / values[sure]))
        determined = (free**2).sum(axis=1)
        if np.linalg.norm(motion[:3]) > 2 * _FARTHEST_M:
            break
    return motion, tuple(n for n, d in zip(NAMES, determined, strict=True) if d > 0.5)


def _without_plane(away: F64, plane: F64) -> F64:
    """Residuals less a robust plane through them, given by its columns (3, n)."""
    level = away - np.median(away)
    for _ in range(_ROUNDS):
        # What stands out of a level surface from the start doesn't tilt it.
        weight = tukey(level)
        found = np.linalg.lstsq((plane * np.sqrt(weight)).T, away * np.sqrt(weight), rcond=None)[0]
        level = away - found @ plane
    return level


def _in_base(motion: F64, centre: F64, height_map: HeightMap) -> F64:
    """The motion as a matrix in base."""
    dx, dy, dz, rx, ry, rz = motion
    local = np.eye(4)
    local[:3, :3] += [[0, -rz, ry], [rz, 0, -rx], [-ry, rx, 0]]
    local[:3, 3] = [dx + rz * centre[1], dy - rz * centre[0], dz - rx * centre[1] + ry * centre[0]]
    base = height_map.base_from_map
    return np.asarray(base @ local @ np.linalg.inv(base))
