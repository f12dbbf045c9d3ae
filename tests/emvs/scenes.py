"""Small analytic scenes: points seen by a moving pinhole camera, one event at each pixel passed."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import rotation_vector_to_quaternion
from roller_emvs.depth_map import DepthMap

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
    assert not camera.is_distorted
    times = np.rint(np.arange(0.0, duration_s, step_s) * 1e9).astype(np.int64)
    to_camera = np.linalg.inv(track_of(motion, duration_s).matrices(times))
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    size = (camera.width, camera.height)
    entered = np.empty((len(times), len(points)), np.int32)
    _pixels_entered(points.astype(float), to_camera, intrinsics, size, entered)
    step, point = np.nonzero(entered >= 0)
    y, x = np.divmod(entered[step, point], camera.width)
    return EventArray.from_arrays(x, y, start_ns + times[step], np.ones(len(x)))


@njit(cache=True)
def _pixels_entered(points, to_camera, intrinsics, size, out):  # type: ignore[no-untyped-def]
    """Number of the pixel that each point enters at each time; -1 where it enters none."""
    fx, fy, cx, cy = intrinsics
    width, height = size
    last = np.full(len(points), -1)
    for k in range(len(to_camera)):
        m = to_camera[k]
        for i in range(len(points)):
            x, y, z = m[:3, 3]
            for j in range(3):
                x += m[0, j] * points[i, j]
                y += m[1, j] * points[i, j]
                z += m[2, j] * points[i, j]
            number = -1
            if z > 0:
                u = np.rint(fx * x / z + cx)
                v = np.rint(fy * y / z + cy)
                if 0 <= u < width and 0 <= v < height:
                    number = int(v) * width + int(u)
            out[k, i] = number if number != last[i] else -1
            last[i] = number


@cache
def tilted_scan(duration_s: float) -> EventArray:
    """Lines on the plate `tilted`, seen while rolling at 0.3 m/s."""
    return events_of(lines(tilted), rolling(0.3), duration_s)


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


def without(track: PoseTrack, first_ms: int, last_ms: int) -> PoseTrack:
    """A track that has no poses between two times, ms."""
    out = PoseTrack(track.max_gap_s)
    kept = (track.times_ns <= first_ms * MS) | (track.times_ns >= last_ms * MS)
    out.extend(track.times_ns[kept], track.positions[kept], track.quaternions[kept])
    return out


def depth_map(depth: np.ndarray, x_m: float = 0.0, confidence: float = 0.5) -> DepthMap:
    """Seen from a place along x, with one confidence."""
    pose = np.eye(4)
    pose[0, 3] = x_m
    sure = np.where(np.isfinite(depth), confidence, np.nan).astype(np.float32)
    return DepthMap(0, depth.astype(np.float32), sure, 1e-5 / sure, pose, 0, 0, 0)


def waking(events: EventArray, dead_ns: int, merged_ns: int = 500_000) -> EventArray:
    """One event a pixel and edge, and another of the other polarity when the pixel wakes up.

    Of half of the rows: where most are busy, all events stay.
    """
    events = events[events.y < CAMERA.height // 2]
    pixel = events.y.astype(np.int64) * 2**16 + events.x
    order = np.lexsort((events.t_ns, pixel))
    again = (np.diff(pixel[order]) == 0) & (np.diff(events.t_ns[order]) < merged_ns)
    first = events[np.sort(order[np.concatenate([[True], ~again])])]
    late = dead_ns + np.arange(len(first)) * 7919 % 50_000
    t = np.concatenate([first.t_ns, first.t_ns + late])
    p = np.concatenate([first.p, 1 - first.p])
    order = np.argsort(t, kind="stable")
    x, y = (np.tile(values, 2)[order] for values in (first.x, first.y))
    return EventArray.from_arrays(x, y, t[order], p[order])
