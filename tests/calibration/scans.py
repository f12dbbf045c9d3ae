"""Scans whose truth is exact: dots on a sphere that stands out of a plate, lines to and fro."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from emvs.scenes import CAMERA, events_of, rolling, track_of
from recording.bags import write_dataset
from roller_calibration.bidirectional import central_events
from roller_calibration.recordings import Scan
from roller_core.camera import Camera
from roller_core.events import EventArray

ROLLING = Camera(320, 140, 800.0, 800.0, 159.5, 69.5)
RADIUS_M, CONTACT_M = 0.004, 0.0029
CENTRE_M = np.array([0.0, 0.0002, 0.0475])
PLATE_M = 0.0452
SPEED_M_S, START_M, ROLLED_M = 0.3, -0.011, 0.0222
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
def sphere_pass(across_m: float = 0.0, dots: int = 400, plate_dots: int = 150) -> Scan:
    """A pass over the sphere, that lies so far beside the middle of the image."""
    centre = CENTRE_M + [0.0, across_m, 0.0]
    parts = [dome_points(centre, RADIUS_M, dots), plate_points(centre, RADIUS_M, plate_dots)]
    duration_s = ROLLED_M / SPEED_M_S
    motion = motion_over()
    events = events_of(np.concatenate(parts), motion, duration_s, camera=ROLLING)
    return Scan("pass", events, ROLLING, track_of(motion, duration_s))


def write_scan(folder: Path, scan: Scan) -> Path:
    """A scan as a folder of the public event-camera dataset."""
    return write_dataset(folder, scan.events, scan.track, scan.camera)


LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
TRAVEL_M, DEPTH_M = 0.02, 0.045
PIXEL_M = DEPTH_M / CAMERA.fx


@dataclass(frozen=True)
class Course:
    """To and fro over `TRAVEL_M` along x: where at a time, and when at a place going there."""

    duration_s: float
    place_m: Callable[[float], float]
    time_s: Callable[[np.ndarray], np.ndarray]

    def motion(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([self.place_m(min(max(t, 0.0), self.duration_s)), 0.0, 0.0]), LEVEL


def there_and_back(speed_m_s: float) -> Course:
    turn_s = TRAVEL_M / speed_m_s
    return Course(
        2 * turn_s, lambda t: TRAVEL_M - speed_m_s * abs(t - turn_s), lambda x: x / speed_m_s
    )


def swinging(period_s: float) -> Course:
    rate, half = 2 * np.pi / period_s, TRAVEL_M / 2
    return Course(
        period_s,
        lambda t: half * (1 - np.cos(rate * t)),
        lambda x: np.arccos(1 - x / half) / rate,
    )


def uneven(seed: int = 3) -> np.ndarray:
    """Places of lines across the path, metres."""
    return np.cumsum(np.random.default_rng(seed).uniform(0.0006, 0.0019, 60)) - 0.02


def scan_of(course: Course, delay_s: float, lines_m: np.ndarray | None = None) -> Scan:
    """Lines that pass a camera, an event as each enters a pixel, its stamp too late.

    What brightens a pixel going there darkens it coming back.
    """
    lines_m = uneven() if lines_m is None else lines_m
    columns = np.arange(CAMERA.width)
    rows = np.arange(0, CAMERA.height, 3)
    found = []
    for sign in (1, -1):
        # Going there the image moves to the left: pixels are entered from the right.
        edge = (columns + 0.5 * sign - CAMERA.cx) * PIXEL_M
        x = lines_m[:, None] - edge[None, :]
        line, column = np.nonzero((x > 0) & (x < TRAVEL_M))
        t = course.time_s(x[line, column])
        found.append(
            (t if sign > 0 else course.duration_s - t, column, (line % 2 == 0) == (sign > 0))
        )
    t, column, on = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(t, kind="stable")
    stamps = np.round((t[order] + delay_s) * 1e9).astype(np.int64)
    events = EventArray.from_arrays(
        np.repeat(column[order], len(rows)), np.tile(rows, len(t)),
        np.repeat(stamps, len(rows)), np.repeat(on[order], len(rows)),
    )  # fmt: skip
    return Scan(
        "scan", central_events(events, CAMERA), CAMERA, track_of(course.motion, course.duration_s)
    )
