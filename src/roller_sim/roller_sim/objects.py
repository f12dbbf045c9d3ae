"""The six test objects: sphere, stairs, sparse sphere, hexagon, bumps and pyramid.

Each function puts one object on a plate, centred across it.
Lengths are in millimetres. Heights and sizes follow what the paper shows of its printed objects,
kept below 1.5 mm so that all contact depths lie within the sensor's range.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .relief import F64, Plate

SPHERE_RADIUS = 4.0
SPHERE_HEIGHT = 1.5
STAIR_RISE, STAIR_TREAD, STAIR_STEPS, STAIR_WIDTH = 0.2, 1.1, 5, 14.0
RING_HEIGHT, RING_RADIUS, RING_COUNT = 1.4, 4.6, 5
HEXAGON_RADIUS, HEXAGON_HEIGHT, RECESS_RADIUS, RECESS_DEPTH = 4.8, 0.9, 3.2, 0.4
BUMP_RADII, BUMP_WIDTH, BUMP_GAP = (0.4, 0.65, 0.9, 1.15), 12.0, 0.6
PYRAMID_BASE, PYRAMID_INSET, PYRAMID_RISE, PYRAMID_STEPS = 10.0, 1.0, 0.25, 5


def put_sphere(
    plate: Plate, x0: float, radius: float = SPHERE_RADIUS, height: float = SPHERE_HEIGHT
) -> None:
    """A ball of 4 mm radius that stands 1.5 mm out of the plate."""
    r = float(np.sqrt(2 * radius * height - height**2))
    xc = x0 + r

    def cap(x: F64, y: F64) -> F64:
        rest = np.maximum(radius**2 - (x - xc) ** 2 - y**2, 0.0)
        return np.maximum(np.sqrt(rest) - (radius - height), 0.0)

    plate.put("sphere", (x0, x0 + 2 * r, -r, r), cap)


def put_stairs(
    plate: Plate,
    x0: float,
    rise: float = STAIR_RISE,
    tread: float = STAIR_TREAD,
    steps: int = STAIR_STEPS,
) -> None:
    """Steps of 0.2 mm up and down again."""
    count = 2 * steps - 1

    def stairs(x: F64, y: F64) -> F64:
        i = np.clip(np.floor((x - x0) / tread + 1e-6), 0, count - 1)
        return rise * (steps - np.abs(i - (steps - 1)))

    plate.put("stairs", (x0, x0 + count * tread, -STAIR_WIDTH / 2, STAIR_WIDTH / 2), stairs)


def put_sparse_sphere(plate: Plate, x0: float) -> None:
    """Terraced rings whose outer edges follow a sphere."""
    r = RING_RADIUS
    ball = (r**2 + RING_HEIGHT**2) / (2 * RING_HEIGHT)
    tread = r / RING_COUNT

    def rings(x: F64, y: F64) -> F64:
        distance = np.hypot(x - x0 - r, y)
        inner = np.floor(distance / tread) * tread
        height = np.sqrt(ball**2 - np.minimum(inner, r) ** 2) - (ball - RING_HEIGHT)
        return np.where(distance < r, height, 0.0)

    plate.put("sparse_sphere", (x0, x0 + 2 * r, -r, r), rings)


def _hexagon_distance(x: F64, y: F64) -> F64:
    """Distance from the centre, measured across the flats of a hexagon with corners along x."""
    return np.maximum(np.abs(y), np.abs(x) * np.sqrt(0.75) + np.abs(y) * 0.5)


def put_hexagon(plate: Plate, x0: float) -> None:
    """A hexagon with a shallow hexagonal recess."""
    flat, recess = HEXAGON_RADIUS * np.sqrt(0.75), RECESS_RADIUS * np.sqrt(0.75)

    def hexagon(x: F64, y: F64) -> F64:
        d = _hexagon_distance(x - x0 - HEXAGON_RADIUS, y)
        return np.where(d <= recess, HEXAGON_HEIGHT - RECESS_DEPTH, HEXAGON_HEIGHT) * (d <= flat)

    plate.put("hexagon", (x0, x0 + 2 * HEXAGON_RADIUS, -flat, flat), hexagon)


def put_bumps(plate: Plate, x0: float) -> None:
    """Half cylinders side by side, of growing radius, across the roll."""

    def bumps(x: F64, y: F64) -> F64:
        height = np.zeros_like(x)
        middle = x0
        for r in BUMP_RADII:
            middle += r
            height = np.maximum(height, np.sqrt(np.maximum(r**2 - (x - middle) ** 2, 0.0)))
            middle += r + BUMP_GAP
        return height

    plate.put("bumps", (x0, x0 + LENGTHS["bumps"], -BUMP_WIDTH / 2, BUMP_WIDTH / 2), bumps)


def put_pyramid(plate: Plate, x0: float) -> None:
    """A square pyramid of five steps."""
    half = PYRAMID_BASE / 2

    def pyramid(x: F64, y: F64) -> F64:
        d = half - np.maximum(np.abs(x - x0 - half), np.abs(y))
        level = np.floor(d / PYRAMID_INSET + 1e-6) + 1
        return PYRAMID_RISE * np.clip(level, 0, PYRAMID_STEPS)

    plate.put("pyramid", (x0, x0 + PYRAMID_BASE, -half, half), pyramid)


OBJECTS: dict[str, Callable[[Plate, float], None]] = {
    "sphere": put_sphere,
    "stairs": put_stairs,
    "sparse_sphere": put_sparse_sphere,
    "hexagon": put_hexagon,
    "bumps": put_bumps,
    "pyramid": put_pyramid,
}
#: Length along the roll, mm.
LENGTHS = {
    "sphere": 2 * float(np.sqrt(2 * SPHERE_RADIUS * SPHERE_HEIGHT - SPHERE_HEIGHT**2)),
    "stairs": (2 * STAIR_STEPS - 1) * STAIR_TREAD,
    "sparse_sphere": 2 * RING_RADIUS,
    "hexagon": 2 * HEXAGON_RADIUS,
    "bumps": 2 * sum(BUMP_RADII) + BUMP_GAP * (len(BUMP_RADII) - 1),
    "pyramid": PYRAMID_BASE,
}
