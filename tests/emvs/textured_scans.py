"""Poses and events of simulated scans of textured plates, for tests."""

from collections.abc import Callable

import numpy as np

from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64, matrix_to_quaternion
from roller_emvs.methods.surface import SurfacePatch, SurfaceSweep
from roller_inspect.results.truth_tally import SurfaceTally
from simulated_scans import SimulatedScan

_MS = 1_000_000


def true_track(
    scan: SimulatedScan, error: Callable[[np.ndarray], np.ndarray] = np.zeros_like
) -> PoseTrack:
    """Where the camera really was: poses' noise hides some micrometres.

    `error` takes places along the motion, m, and gives what poses there are off by.
    """
    first, last = int(scan.events.t_ns[0]), int(scan.events.t_ns[-1])
    times = np.arange(first - 50 * _MS, last, 2 * _MS)
    rotation = scan.track.matrices(scan.events.t_ns[len(scan.events) // 2])[0, :3, :3]
    places = scan.truth.camera_positions(times)
    places[:, 0] += error(places[:, 0])
    track = PoseTrack()
    for t_ns, place in zip(times, places, strict=True):
        track.append(int(t_ns), place, matrix_to_quaternion(rotation))
    return track


def steady(scan: SimulatedScan) -> EventArray:
    """Events while the camera goes at constant speed."""
    start, (first, last) = scan.truth.start_ros_ns, scan.truth.path.even_s
    t_ns = scan.events.t_ns
    return scan.events[(t_ns > start + first * 1e9) & (t_ns < start + last * 1e9)]


def swept_points(sweep: SurfaceSweep, scan: SimulatedScan) -> F64:
    """Points of a scan's steady part, x, y and z, on the plate; shape (n, 3)."""
    sweep.add_events(steady(scan))
    tally = SurfaceTally(scan.truth)
    for found in sweep.results(flush=True):
        if isinstance(found, SurfacePatch):
            tally.add_points(found.points, found.stamp_ns)
    return tally.points
