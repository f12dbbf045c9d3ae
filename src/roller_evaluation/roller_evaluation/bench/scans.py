"""Scans with known truth, simulated once and kept."""

from __future__ import annotations

import copy
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from roller_core.camera import Camera
from roller_core.errors import RollerError, UnwritableOutputError
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_recording.reading import open_recording
from roller_sim.bag import write_bag
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.truth import Truth

_ASKED_FILE = "asked.yaml"
#: Travel over an object whose windows are compared: just over two windows of 12 mm, four of 6 mm
#: or one of 20 mm, so that no rule leaves half a window over.
CROSSING_M = 0.0245


@dataclass(frozen=True)
class Scan:
    """A scan of one object, held in memory.

    Attributes
    ----------
    name : str
        The object.
    speed : float
        m/s.
    events : EventArray
        Events at constant speed, ROS time.
    track : PoseTrack
        Camera in base, as measured.
    camera : Camera
        Calibration.
    truth : Truth
        The truth.
    """

    name: str
    speed: float
    events: EventArray
    track: PoseTrack
    camera: Camera
    truth: Truth

    def crossing(self) -> EventArray:
        """Events while the camera's axis is within half of `CROSSING_M` of the object's middle."""
        first, last = _even_span(self.truth)
        times = np.linspace(first, last, 2001).astype(np.int64)
        x = self.truth.camera_positions(times)[:, 0]
        region = self.truth.objects.get(self.name)
        middle = 0.5 * (region.x0 + region.x1) if region else float(x.mean())
        near = times[np.abs(x - middle) <= 0.5 * CROSSING_M]
        return between(self.events, int(near[0]), int(near[-1])) if len(near) else self.events


def between(events: EventArray, start_ns: int, end_ns: int) -> EventArray:
    """Events from a time (included) to another (excluded)."""
    first, last = np.searchsorted(events.t_ns, [start_ns, end_ns])
    return events[int(first) : int(last)]


def scan_settings(name: str, speed: float, changes: Mapping[str, Any]) -> VirtualCellSettings:
    """Settings of the virtual cell for one object.

    Parameters
    ----------
    name : str
        The object.
    speed : float
        m/s.
    changes : mapping
        Other settings, by group where they have one, as in a parameter file.
    """
    values: dict[str, Any] = copy.deepcopy(dict(changes))
    values.setdefault("scene", {})["name"] = name
    values.setdefault("motion", {})["speed"] = speed
    # Pictures for people would only take time.
    values.setdefault("clock", {})["image_rate_hz"] = 0.0
    return VirtualCellSettings.create(values, "bench")


def get_scan(
    folder: Path, name: str, speed: float, changes: Mapping[str, Any] | None = None
) -> Scan:
    """Read a scan from a folder of scans; simulate it first if it isn't there as asked for.

    The scans are bags with their truth, as `roller simulate` writes them.

    Parameters
    ----------
    folder : path
        Where scans are kept.
    name, speed, changes
        See `scan_settings`.

    Raises
    ------
    UnwritableOutputError
        If the scan can't be kept.
    RollerError
        If there is no such object.
    """
    settings = scan_settings(name, speed, changes or {})
    bag = folder / f"{name}_{speed:g}"
    if _asked(bag) != settings.model_dump(mode="json"):
        _simulate(settings, bag)
    recording = open_recording(bag)
    parts = [step.events for step in recording.steps() if len(step.events)]
    truth = Truth.load(bag)
    events = between(EventArray.concatenate(parts), *_even_span(truth))
    if not len(events):
        raise RollerError(f"{bag}: the scan holds no events")
    return Scan(name, speed, events, recording.track, recording.camera, truth)


def _asked(bag: Path) -> Any:
    try:
        return yaml.safe_load((bag / _ASKED_FILE).read_text())
    except (OSError, yaml.YAMLError):
        return None


def _simulate(settings: VirtualCellSettings, bag: Path) -> None:
    cell = VirtualCell(settings)
    try:
        bag.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(bag, ignore_errors=True)
        write_bag(cell, bag)
        # Last, so that a scan that was broken off is made anew.
        (bag / _ASKED_FILE).write_text(yaml.safe_dump(settings.model_dump(mode="json")))
    except OSError as error:
        raise UnwritableOutputError(f"{bag}: the scan can't be kept ({error})") from error


def _even_span(truth: Truth) -> tuple[int, int]:
    """ROS times between which the camera goes at constant speed."""
    first, last = truth.path.even_s
    return truth.start_ros_ns + round(first * 1e9), truth.start_ros_ns + round(last * 1e9)
