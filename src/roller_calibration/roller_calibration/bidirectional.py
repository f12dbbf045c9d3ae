"""Scans that go to and fro: where the camera was, and where its events lie on the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_core.transforms import F64

from .recordings import Scan

I64 = npt.NDArray[np.int64]

#: Rays that lean further along the path are left out: relief moves them, dx/dz.
MOST_LEAN = 0.1
#: Poses are interpolated between grid points this far apart, ns.
_GRID_NS = 1_000_000
#: A pass is where the speed is above this share of its highest.
_MOVING = 0.2
#: Least travel that both passes have been over, metres, and events in each.
LEAST_TRAVEL_M, LEAST_EVENTS = 0.004, 2000


class TimeOffsetError(RollerError):
    """A recording from which the offset can't be found."""


def central_events(events: EventArray, camera: Camera) -> EventArray:
    """Events near the image's middle row or column: all that can count, whichever the direction."""
    reach_u, reach_v = MOST_LEAN * camera.fx, MOST_LEAN * camera.fy
    u, v = events.x.astype(np.float64), events.y.astype(np.float64)
    return events[(np.abs(u - camera.cx) <= reach_u) | (np.abs(v - camera.cy) <= reach_v)]


@dataclass(frozen=True)
class Course:
    """A scan's path: its direction in base, and place and speed along it on a grid of times."""

    along: F64
    grid_ns: I64
    travel_m: F64
    speed_m_s: F64


def by_pixel(scan: Scan) -> tuple[I64, npt.NDArray[np.bool_]]:
    """Order of the events pixel by pixel, each in order of time, and whether the next is of it."""
    events = scan.events
    pixel = events.y.astype(np.int32) * scan.camera.width + events.x
    order = np.argsort(pixel, kind="stable")
    return order, np.diff(pixel[order]) == 0


def close_edges(scan: Scan, course: Course, apart_m: float) -> EventArray:
    """Events whose pixel had one of the other polarity less than so much travel before."""
    events = scan.events
    way_m = np.append(0.0, np.cumsum(np.abs(np.diff(course.travel_m))))
    gone_m = np.interp(events.t_ns, course.grid_ns, way_m)
    order, far = by_pixel(scan)
    far &= np.diff(events.p[order].astype(np.int8)) != 0
    far &= np.diff(gone_m[order]) < apart_m
    kept = np.zeros(len(events), bool)
    kept[order[1:]] = far
    return events[kept]


@dataclass(frozen=True)
class Pass:
    """Places of one pass: along and across the path, metres; which events are ON."""

    along_m: F64
    across_m: F64
    on: npt.NDArray[np.bool_]


def course_of(scan: Scan) -> Course:
    """Travel and speed of a scan along its main direction.

    Raises
    ------
    TimeOffsetError
        If it doesn't go to and fro.
    """
    track = scan.track
    if not len(scan.events) or len(track) < 2:
        raise TimeOffsetError("there are no events or no poses to compare")
    centred = track.positions - track.positions.mean(axis=0)
    along = np.linalg.svd(centred, full_matrices=False)[2][0]
    grid = np.arange(track.start_ns, track.end_ns, _GRID_NS, dtype=np.int64)
    if len(grid) < 50 or np.ptp(centred @ along) < LEAST_TRAVEL_M:
        raise TimeOffsetError(
            f"the sensor moves by less than {LEAST_TRAVEL_M * 1e3:g} mm: roll it to and fro"
        )
    travel = track.sample(grid)[0] @ along
    # Poses carry noise of micrometres: the slope over 20 ms.
    smooth = np.convolve(np.pad(travel, 10, mode="edge"), np.full(21, 1 / 21), mode="valid")
    speed = np.gradient(smooth, _GRID_NS * 1e-9)
    for sign in (1.0, -1.0):
        moving = sign * speed > _MOVING * np.abs(speed).max()
        if not moving.any() or np.ptp(travel[moving]) < LEAST_TRAVEL_M:
            raise TimeOffsetError(
                "the scan rolls one way only: roll to and fro over the same place"
            )
    return Course(along, grid, travel, speed)


def passes_of(scan: Scan, course: Course, depth_m: float, delay_s: float) -> tuple[Pass, Pass]:
    """Where the events of both passes lie on the surface, for a delay of their stamps."""
    events, camera, track = scan.events, scan.camera, scan.track
    along, grid, speed = course.along, course.grid_ns, course.speed_m_s
    times = events.t_ns - round(delay_s * 1e9)
    at = np.clip((times - grid[0]) // _GRID_NS, 0, len(grid) - 1)
    inside = (times >= grid[0]) & (times <= grid[-1])
    rotations = track.matrices(grid)[:, :3, :3]
    positions = track.sample(grid)[0]
    axis = rotations[:, :, 2].mean(axis=0)
    across = np.cross(axis, along)
    table = camera.undistortion_table()
    rays = table[events.y, events.x].astype(np.float64)
    local = np.column_stack(
        [(rays[:, 0] - camera.cx) / camera.fx, (rays[:, 1] - camera.cy) / camera.fy]
    )

    def component(direction: F64) -> F64:
        """Of the rays, at unit depth."""
        turned = direction @ rotations
        return np.asarray(turned[at, 0] * local[:, 0] + turned[at, 1] * local[:, 1] + turned[at, 2])

    lean = component(along)
    # The middle ray's own lean is the camera's, not the pixel's.
    inside &= np.abs(lean - np.median(along @ rotations[:, :, 2].T)) <= MOST_LEAN
    s = np.interp(times, grid, course.travel_m) + depth_m * lean
    r = np.interp(times, grid, positions @ across) + depth_m * component(across)
    v = np.interp(times, grid, speed)
    found = []
    for sign, name in ((1.0, "forward"), (-1.0, "back")):
        own = inside & (sign * v > _MOVING * np.abs(speed).max())
        if np.count_nonzero(own) < LEAST_EVENTS:
            raise TimeOffsetError(
                f"the pass {name} has {np.count_nonzero(own)} events of use, fewer than "
                f"{LEAST_EVENTS}: roll to and fro over a surface with relief"
            )
        found.append(Pass(s[own], r[own], events.p[own] > 0))
    return found[0], found[1]


def closing_speed(course: Course, at_m: F64) -> F64:
    """Speed of the one pass plus that of the other at places; 0 where one wasn't."""
    total = np.zeros(len(at_m))
    both = np.ones(len(at_m), bool)
    # The camera is over what it sees: its place and the place seen are one for the middle ray.
    for sign in (1.0, -1.0):
        moving = sign * course.speed_m_s > _MOVING * np.abs(course.speed_m_s).max()
        order = np.argsort(course.travel_m[moving])
        travel, speed = course.travel_m[moving][order], sign * course.speed_m_s[moving][order]
        both &= (at_m >= travel[0]) & (at_m <= travel[-1])
        total += np.interp(at_m, travel, speed)
    return np.where(both, total, 0.0)
