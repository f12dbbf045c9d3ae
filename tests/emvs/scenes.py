"""Small analytic scenes: points seen by a moving pinhole camera, one event at each pixel passed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import inverse_pose, rotation_vector_to_quaternion

CAMERA = Camera(320, 120, 800.0, 800.0, 159.5, 59.5)
MS = 1_000_000

Motion = Callable[[float], tuple[np.ndarray, np.ndarray]]


def rolling(speed_m_s: float, base: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Motion:
    """Along x at a constant speed, the camera's axes those of base."""
    return lambda t: (np.array(base) + [speed_m_s * t, 0.0, 0.0], np.array([0.0, 0.0, 0.0, 1.0]))


def turning(rate_rad_s: float) -> Motion:
    """On the spot, about the camera's y axis."""
    return lambda t: (np.zeros(3), rotation_vector_to_quaternion([0.0, rate_rad_s * t, 0.0]))


def track_of(motion: Motion, duration_s: float, start_ns: int = 0) -> PoseTrack:
    """Poses at 125 Hz, one beyond the end."""
    track = PoseTrack()
    for k in range(int(duration_s / 0.008) + 3):
        track.append(start_ns + k * 8 * MS, *motion(k * 0.008))
    return track


def events_of(
    points: np.ndarray,
    motion: Motion,
    duration_s: float,
    start_ns: int = 0,
    step_s: float = 50e-6,
    camera: Camera = CAMERA,
) -> EventArray:
    """An event wherever a point (in base, metres, shape (n, 3)) enters another pixel."""
    track = track_of(motion, duration_s)
    last = np.full(len(points), -1)
    parts = []
    # Twice what the pinhole sees; what is farther out need not be projected.
    reach = np.array([camera.width / camera.fx, camera.height / camera.fy])
    for t in np.arange(0.0, duration_s, step_s):
        t_ns = round(t * 1e9)
        to_camera = inverse_pose(track.at(t_ns).matrix)
        local = points @ to_camera[:3, :3].T + to_camera[:3, 3]
        near = np.flatnonzero((np.abs(local[:, :2]) < reach * local[:, 2:]).all(axis=1))
        pixel = np.rint(camera.project(local[near])).astype(int)
        inside = ((pixel >= 0) & (pixel < (camera.width, camera.height))).all(axis=1)
        number = np.full(len(points), -1)
        number[near[inside]] = pixel[inside, 1] * camera.width + pixel[inside, 0]
        new = np.flatnonzero((number >= 0) & (number != last))
        last = number
        y, x = np.divmod(number[new], camera.width)
        parts.append((x, y, np.full(len(new), start_ns + t_ns)))
    x, y, t_all = (np.concatenate(column) for column in zip(*parts, strict=True))
    return EventArray.from_arrays(x, y, t_all, np.ones(len(x)))


def lines(depth: Callable[[np.ndarray], np.ndarray], pitch_m: float = 0.0013) -> np.ndarray:
    """Points on lines across the roll, so dense along y that they act as edges."""
    x = np.arange(-0.02, 0.045, pitch_m)
    # Uneven spacing, so that no other depth lets neighbours fall together.
    x = x + 0.35 * pitch_m * np.sin(7.0 * np.arange(len(x)))
    y = np.arange(-0.0036, 0.0036, 0.00005)
    grid_x, grid_y = (a.ravel() for a in np.meshgrid(x, y))
    return np.stack([grid_x, grid_y, depth(grid_x)], axis=-1)


def tilted(x: np.ndarray) -> np.ndarray:
    """Depth of a plane that rises along the roll, metres."""
    return 0.045 + 0.03 * (x - 0.01)
