"""Recordings as calibrations read them: all at once, and without faults."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from roller_core.calibration_file import CalibrationError, check_same_camera, same_camera
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.parameter_files import read_parameters
from roller_core.pose_track import PoseTrack
from roller_core.progress import progress_bar
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import F64
from roller_recording.reading import Recording


@dataclass(frozen=True)
class Scan:
    """A recorded scan."""

    #: What to call it.
    name: str
    #: All events, in order of time.
    events: EventArray
    #: Calibration.
    camera: Camera
    #: Camera in base over the whole scan.
    track: PoseTrack
    #: Camera on the frame that the robot moves, as it was recorded with, shape (4, 4); None where
    #: that isn't known.
    hand_eye: F64 | None = None


def read_scan(
    path: Path,
    args: argparse.Namespace,
    max_gap_s: float,
    keep: Callable[[EventArray, Camera], EventArray] = lambda events, _camera: events,
) -> Scan:
    """Read a recording.

    Parameters
    ----------
    path : path
        Recording.
    args : Namespace
        With the options of recordings; the frames are those of `emvs` in `--params`.
    max_gap_s : float
        See `PoseTrack`.
    keep : callable
        Takes events and the camera, gives those that count.

    Raises
    ------
    RollerError
        If it can't be read, anything in it is wrong, or `--params` is of another camera.
    """
    from roller_emvs.depth_stage import EmvsParameters
    from roller_recording.reading import open_recording

    recording = open_recording(path, args.poses, args.camera, max_gap_s, args.topic)
    check_same_camera(args.params, recording.camera)
    s = EmvsParameters.create(read_parameters(args.params, "emvs"))
    recording.follow(
        SensorFrames(s.base_frame, s.moving_frame, s.sensor_frame, max_gap_s, s.pose_smoothing)
    )
    with progress_bar(f"read {path.name}") as progress:
        return whole_scan(recording, path.name, keep, progress)


def whole_scan(
    recording: Recording,
    name: str = "scan",
    keep: Callable[[EventArray, Camera], EventArray] = lambda events, _camera: events,
    progress: Callable[[float], None] = lambda share: None,
) -> Scan:
    """All of a recording; see `read_scan`.

    Raises
    ------
    CalibrationError
        If anything in it is wrong, or it has no events.
    """
    parts = []
    for step in recording.steps():
        if step.faults:
            raise CalibrationError(f"{recording.source}: {step.faults[0]}")
        if len(step.events):
            parts.append(keep(step.events, recording.camera))
        progress(step.progress)
    if not parts:
        raise CalibrationError(f"{recording.source}: too few events: there are none")
    events = EventArray.concatenate(parts)
    return Scan(name, events, recording.camera, recording.track, recording.hand_eye)


def read_scans(
    args: argparse.Namespace,
    max_gap_s: float,
    keep: Callable[[EventArray, Camera], EventArray] = lambda events, _camera: events,
) -> list[Scan]:
    """Read all recordings of one camera, the command's `inputs`; see `read_scan`.

    Raises
    ------
    RollerError
        As `read_scan`; or if they are of different cameras, one is given twice, or several would
        share one file of poses.
    """
    if args.poses and len(args.inputs) > 1:
        raise CalibrationError("--poses goes with one recording; convert the others to bags")
    places = [path.resolve() for path in args.inputs]
    for k, path in enumerate(places):
        if path in places[:k]:
            raise CalibrationError(f"{args.inputs[k]}: given twice")
    scans = [read_scan(path, args, max_gap_s, keep) for path in args.inputs]
    names = [scan.name for scan in scans]
    for scan in scans[1:]:
        if not same_camera(scan.camera, scans[0].camera):
            raise CalibrationError(f"{scan.name} and {scans[0].name} are of different cameras")
    return [
        scan if names.count(scan.name) == 1 else replace(scan, name=str(path))
        for scan, path in zip(scans, args.inputs, strict=True)
    ]
