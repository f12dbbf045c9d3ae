"""Pairs of poses for hand-eye, from a recording in which the camera sees the grid of dots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.frame_names import BASE_FRAME, TOOL_FRAME
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import F64
from roller_recording.reading import open_recording

from .dot_grid import DotGrid, GridWatcher
from .intrinsics import grid_in_camera

#: The robot stands still in a view if its tool moves no further, metres and radians.
_STILL_M, _STILL_RAD = 1e-4, 1e-3
#: Longest gap of its poses, s: while the grid stands still in the image, so does the robot.
_MAX_GAP_S = 0.5


class GridPosesError(RollerError):
    """A recording that gives no pairs of poses."""


def pairs_of_poses(
    path: Path,
    grid: DotGrid,
    camera_file: Path | None = None,
    topic: str | None = None,
    base_frame: str = BASE_FRAME,
    moving_frame: str = TOOL_FRAME,
    on_fault: Callable[[RollerError], None] = lambda fault: None,
    on_progress: Callable[[float], None] = lambda share: None,
) -> tuple[Camera, list[tuple[F64, F64]]]:
    """The tool in base and the grid in the camera, wherever robot and grid stood still.

    Parameters
    ----------
    path : path
        A bag with events, the calibrated camera and the robot's poses.
    grid : DotGrid
        The target.
    camera_file : path, optional
        ROS camera_info YAML, for bags without one.
    topic : str, optional
        Of the event packets, where there are several.
    base_frame, moving_frame : str
        The robot's base and the tool's frame.
    on_fault : callable
        Takes what is wrong with the recording and leaves the rest of it readable.
    on_progress : callable
        Takes the share that was read, 0–1.

    Returns
    -------
    camera : Camera
        Its calibration.
    pairs : list of tuple of ndarray, shapes (4, 4)
        Metres.

    Raises
    ------
    RollerError
        If the recording can't be read or has no such views.
    """
    recording = open_recording(path, None, camera_file, topic=topic)
    tool = SensorFrames(base_frame, moving_frame, moving_frame, max_gap_s=_MAX_GAP_S)
    watcher = GridWatcher(recording.camera, grid)
    for step in recording.items():
        for fault in step.faults:
            on_fault(fault)
        for transform in step.transforms:
            try:
                tool.take(transform)
            except RollerError as error:
                on_fault(error)
        watcher.add_events(step.events)
        on_progress(step.progress)
    tool.finish()
    views, pairs = watcher.finish(), []
    for view in views:
        times = np.linspace(view.begin_ns, view.end_ns, 9).astype(np.int64)
        if not tool.track.covers(int(times[0]), int(times[-1])):
            continue
        poses = tool.track.matrices(times)
        if not _still(poses):
            continue
        pairs.append((poses[len(poses) // 2], grid_in_camera(view, grid, recording.camera)))
    if not pairs:
        raise GridPosesError(
            f"{path}: no view in which grid and robot stand still ({watcher.found} of "
            f"{watcher.windows} windows show the grid, {len(views)} views of it): stop for 2 s at "
            "each pose; are there poses of the robot?"
        )
    return recording.camera, pairs


def _still(poses: F64) -> bool:
    moved = np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3], axis=1).max()
    turned = np.abs(poses[:, :3, :3] - poses[0, :3, :3]).max()
    return bool(moved <= _STILL_M and turned <= _STILL_RAD)
