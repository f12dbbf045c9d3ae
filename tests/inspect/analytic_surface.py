"""Clouds of analytic surfaces, as the roller would give them."""

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_emvs.patch import Patch

#: Standard deviation of a point, and length over which errors are alike, m.
NOISE_M, ALIKE_M = 15e-6, 2e-4

Surface = Callable[[F64, F64], F64]


def flat(x: F64, y: F64) -> F64:
    """A plane at height 0."""
    return np.zeros(np.broadcast(x, y).shape)


def dent(at: tuple[float, float], radius_m: float, depth_m: float) -> Surface:
    """A round hollow (rise, where the depth is negative) with a smooth rim."""

    def height(x: F64, y: F64) -> F64:
        r = np.hypot(x - at[0], y - at[1]) / radius_m
        return np.where(r < 1, -depth_m * (1 - r**2) ** 2, 0.0)

    return height


def errors(
    shape: tuple[int, int], step_m: float, noise_m: float, random: np.random.Generator
) -> F64:
    """Errors over a grid, alike within `ALIKE_M`."""
    grid = ndimage.gaussian_filter(random.normal(size=shape), ALIKE_M / step_m)
    return np.asarray(grid / grid.std() * noise_m)


def scan(
    surface: Surface,
    length_m: float = 0.03,
    width_m: float = 0.012,
    per_mm2: float = 110.0,
    noise_m: float = NOISE_M,
    keep: Callable[[F64, F64], F64] | None = None,
    seed: int = 0,
    block_m: float = 4e-3,
    start: tuple[float, float] = (0.0, 0.0),
) -> list[Patch]:
    """Patches in the order of a scan along x; errors of neighbouring points are alike.

    Parameters
    ----------
    surface : callable
        Height by x and y, metres.
    keep : callable, optional
        Truth by x and y: points that are there; holes where it is false.
    """
    random = np.random.default_rng(seed)
    n = round(length_m * width_m * 1e6 * per_mm2)
    x = start[0] + random.uniform(0, length_m, n)
    y = start[1] + random.uniform(-width_m / 2, width_m / 2, n)
    step = 1e-4
    shape = (round(width_m / step) + 2, round(length_m / step) + 2)
    error = errors(shape, step, noise_m, random)
    at = ((y - start[1] + width_m / 2) / step, (x - start[0]) / step)
    z = surface(x, y) + ndimage.map_coordinates(error, at, order=1)
    z += random.normal(0, noise_m / 3, n)
    if keep is not None:
        kept = np.asarray(keep(x, y), bool)
        x, y, z = x[kept], y[kept], z[kept]
    block = np.floor((x - start[0]) / block_m).astype(int)
    out = []
    for k in np.unique(block):
        mine = block == k
        points = np.column_stack([x[mine], y[mine], z[mine]])
        out.append(
            Patch(
                points,
                z[mine].astype(np.float32),
                np.full(len(points), 0.5, np.float32),
                np.full(len(points), noise_m, np.float32),
            )
        )
    return out
