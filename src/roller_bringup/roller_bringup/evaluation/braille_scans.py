"""Scans of Braille plates by the virtual cell, held in memory and read as often as asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from roller_braille.pipeline import BraillePipeline
from roller_braille.settings import POSE_SMOOTHING, BrailleSettings
from roller_core.camera import Camera
from roller_core.codecs import encode
from roller_core.event_stream import EventStream
from roller_core.events import EventArray
from roller_core.frames import SensorFrames
from roller_core.pose_track import PoseTrack
from roller_core.transforms import matrix_to_quaternion
from roller_driver.virtual.cell import Packet, PoseSample, VirtualCell
from roller_driver.virtual.settings import VirtualCellSettings


@dataclass(frozen=True)
class BrailleScan:
    """A scan of one plate.

    Attributes
    ----------
    packets : list of EventArray
        Events in ROS time, packet by packet as the node gets them.
    track : PoseTrack
        Camera in base, as measured.
    camera : Camera
        Calibration.
    lines : list of str
        The true text.
    """

    packets: list[EventArray]
    track: PoseTrack
    camera: Camera
    lines: list[str]


@dataclass(frozen=True)
class Reading:
    """What the reader made of a scan.

    Attributes
    ----------
    lines : list of str
        Text.
    milliseconds : list of float
        Time of each frame.
    events : int
        Events in the frames.
    """

    lines: list[str]
    milliseconds: list[float]
    events: int


def simulate(
    text: str, speed: float, changes: Mapping[str, Any], seed: int, start_mm: float | None = None
) -> BrailleScan:
    """Roll the virtual cell over a plate.

    Parameters
    ----------
    text : str
        Lines of text.
    speed : float
        m/s.
    changes : mapping
        Other settings of the virtual cell by group, as in a parameter file.
    seed : int
        Seed of all chance.
    start_mm : float, optional
        Camera's x where full speed begins; None: before the text comes into view.

    Raises
    ------
    RollerError
        If the settings or the text are no good.
    """
    values: dict[str, Any] = {
        name: dict(entry) if isinstance(entry, Mapping) else entry
        for name, entry in changes.items()
    }
    values.setdefault("scene", {}).update(name="braille", text=text)
    values.setdefault("motion", {}).update(speed=speed, start_mm=start_mm)
    # Pictures for people would only take time.
    values.setdefault("clock", {})["image_rate_hz"] = 0.0
    cell = VirtualCell(VirtualCellSettings.create({**values, "seed": seed}, "evaluate"))
    frames = SensorFrames(smoothing=POSE_SMOOTHING)
    fixed = cell.hand_eye
    frames.add_static(
        frames.moving, frames.sensor, fixed[:3, 3], matrix_to_quaternion(fixed[:3, :3])
    )
    size = cell.camera.width, cell.camera.height
    stream = EventStream(*size)
    packets = []
    for item in cell.run():
        if isinstance(item, Packet):
            payload = encode("mono", item.events, item.time_base_ns)
            events = stream.push("mono", *size, item.seq, item.stamp_ns, item.time_base_ns, payload)
            packets.append(events)
        elif isinstance(item, PoseSample):
            frames.add(frames.base, frames.moving, item.stamp_ns, item.position, item.quaternion)
    return BrailleScan(packets, frames.track, cell.camera, cell.truth.text.split("\n"))


def with_wrong_speed(track: PoseTrack, factor: float) -> PoseTrack:
    """The track of a robot that says it goes so many times as fast as it does."""
    out = PoseTrack(track.max_gap_s)
    origin = track.positions[0]
    for t, p, q in zip(track.times_ns, track.positions, track.quaternions, strict=True):
        out.append(int(t), np.asarray(origin + (p - origin) * factor), q)
    return out


def read(scan: BrailleScan, settings: Mapping[str, Any], speed_factor: float = 1.0) -> Reading:
    """Read a scan.

    Parameters
    ----------
    scan : BrailleScan
        The scan.
    settings : mapping
        Settings of the reader that aren't the defaults.
    speed_factor : float
        The poses' speed by the true one.

    Raises
    ------
    SettingsError
        If a setting is no good.
    """
    track = scan.track if speed_factor == 1.0 else with_wrong_speed(scan.track, speed_factor)
    pipeline = BraillePipeline(BrailleSettings.create(dict(settings)), scan.camera, track)
    for events in scan.packets:
        pipeline.add_events(events)
        for _ in pipeline.results():
            pass
    for _ in pipeline.results(flush=True):
        pass
    return Reading(pipeline.text(), list(pipeline.milliseconds), pipeline.counts.events)
