"""A pass over dots on a sphere that stands out of a plate: a scan whose truth is exact."""

from __future__ import annotations

from functools import cache

import numpy as np

from emvs.scenes import events_of, rolling, track_of
from roller_calibration import Rolled
from roller_core.camera import Camera

CAMERA = Camera(320, 140, 800.0, 800.0, 159.5, 69.5)
RADIUS_M, CONTACT_M = 0.004, 0.0029
CENTRE_M = np.array([0.0, 0.0002, 0.0475])
PLATE_M = 0.0452
SPEED_M_S, START_M, WAY_M = 0.3, -0.011, 0.0222
#: In base the camera looks along z: the surface's outside is where z is less.
TOWARDS = np.array([0.0, 0.0, -1.0])


def dome_points(
    centre: np.ndarray, radius: float, count: int, seed: int = 0, noise_m: float = 0.0
) -> np.ndarray:
    """Points on the part of a sphere that the skin touches, metres."""
    rng = np.random.default_rng(seed)
    rho = CONTACT_M / RADIUS_M * radius * np.sqrt(rng.random(count))
    angle = rng.uniform(0, 2 * np.pi, count)
    xy = np.stack([rho * np.cos(angle), rho * np.sin(angle)], axis=-1)
    z = -np.sqrt(radius**2 - rho**2) + rng.normal(0, noise_m, count)
    return centre + np.column_stack([xy, z])


def plate_points(
    centre: np.ndarray, radius: float, count: int, seed: int = 1, noise_m: float = 0.0
) -> np.ndarray:
    """Points on the plate around a sphere, metres."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.016, 0.016, count), rng.uniform(-0.0035, 0.0035, count)
    z = PLATE_M + rng.normal(0, noise_m, count)
    far = np.hypot(x - centre[0], y - centre[1]) > 1.05 * CONTACT_M / RADIUS_M * radius
    return np.column_stack([x, y, z])[far]


def motion_over(start_m: float = START_M):
    return rolling(SPEED_M_S, (start_m, 0.0, 0.0))


@cache
def sphere_pass(across_m: float = 0.0, dots: int = 400, plate_dots: int = 150) -> Rolled:
    """A pass over the sphere, that lies so far beside the middle of the image."""
    centre = CENTRE_M + [0.0, across_m, 0.0]
    parts = [dome_points(centre, RADIUS_M, dots), plate_points(centre, RADIUS_M, plate_dots)]
    duration_s = WAY_M / SPEED_M_S
    motion = motion_over()
    events = events_of(np.concatenate(parts), motion, duration_s, camera=CAMERA)
    return Rolled("pass", events, CAMERA, track_of(motion, duration_s))
