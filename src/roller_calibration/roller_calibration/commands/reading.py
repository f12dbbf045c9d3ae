"""Recordings as calibrations read them: all at once, and without faults."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from roller_calibration import Rolled
from roller_core.calibration_file import CalibrationError, refuse_other_camera, same_camera
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.progress import progress_bar


def read_whole(
    path: Path,
    args: argparse.Namespace,
    max_gap_s: float,
    keep: Callable[[EventArray, Camera], EventArray] = lambda events, _camera: events,
) -> Rolled:
    """Read a recording.

    Parameters
    ----------
    path : path
        Recording.
    args : Namespace
        With the options of recordings.
    max_gap_s : float
        See `PoseTrack`.
    keep : callable
        Takes events and the camera, gives those that count.

    Raises
    ------
    RollerError
        If it can't be read, anything in it is wrong, or `--params` is of another camera.
    """
    from roller_recording.reading import open_recording

    recording = open_recording(path, args.poses, args.camera, max_gap_s, args.topic)
    refuse_other_camera(args.params, recording.camera)
    parts = []
    with progress_bar(f"read {path.name}") as progress:
        for step in recording.steps():
            if step.faults:
                raise CalibrationError(f"{path}: {step.faults[0]}")
            if len(step.events):
                parts.append(keep(step.events, recording.camera))
            progress(step.progress)
    if not parts:
        raise CalibrationError(f"{path}: too few events: there are none")
    return Rolled(path.name, EventArray.concatenate(parts), recording.camera, recording.track)


def read_all(args: argparse.Namespace, max_gap_s: float) -> list[Rolled]:
    """Read all recordings of one camera, the command's `inputs`.

    Raises
    ------
    RollerError
        As `read_whole`; or if they are of different cameras.
    """
    refuse_shared_poses(args)
    places = [path.resolve() for path in args.inputs]
    for k, path in enumerate(places):
        if path in places[:k]:
            raise CalibrationError(f"{args.inputs[k]}: given twice")
    found = [read_whole(path, args, max_gap_s) for path in args.inputs]
    names = [rolled.name for rolled in found]
    found = [
        rolled if names.count(rolled.name) == 1 else replace(rolled, name=str(path))
        for rolled, path in zip(found, args.inputs, strict=True)
    ]
    for rolled in found[1:]:
        if not same_camera(rolled.camera, found[0].camera):
            raise CalibrationError(f"{rolled.name} and {found[0].name} are of different cameras")
    return found


def refuse_shared_poses(args: argparse.Namespace) -> None:
    """Refuse one file of poses for several recordings.

    Raises
    ------
    CalibrationError
        If so.
    """
    if args.poses and len(args.inputs) > 1:
        raise CalibrationError("--poses goes with one recording; convert the others to bags")
