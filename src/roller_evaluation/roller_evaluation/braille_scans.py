"""Scans of Braille plates by the virtual cell, held in memory and read as often as asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import POSE_SMOOTHING, BrailleSettings
from roller_core.camera import Camera
from roller_core.codecs import encode
from roller_core.event_stream import EventStream
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import matrix_to_quaternion
from roller_sim.cell import Packet, PoseSample, VirtualCell
from roller_sim.cell_settings import VirtualCellSettings

#: Text whose middle cell has dots enough to measure them.
_DOTS = "qqq"


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


def dot_contrast(changes: Mapping[str, Any], seed: int) -> float:
    """By how much a Braille dot changes the log intensity that a pixel sees.

    The median, over a few dots in the middle of the view, of the span of log intensity around one;
    without the coating's speckle. An event needs a change by the sensor's threshold.

    Parameters
    ----------
    changes : mapping
        As for `simulate`; text and speed don't matter.
    seed : int
        Seed of all chance.

    Raises
    ------
    RollerError
        If the settings are no good.
    """
    values: dict[str, Any] = {
        name: dict(entry) if isinstance(entry, Mapping) else entry
        for name, entry in changes.items()
    }
    values.setdefault("light", {})["speckle"] = 0.0
    values.setdefault("scene", {}).update(name="braille", text=_DOTS)
    cell = VirtualCell(VirtualCellSettings.create({**values, "seed": seed}, "evaluate"))
    middle = cell.truth.marks[len(cell.truth.marks) // 2]
    times = cell.truth.start_ros_ns + np.linspace(0, cell.truth.duration_ns, 2000).astype(np.int64)
    places = cell.truth.camera_positions(times)
    nearest = int(np.argmin(np.abs(places[:, 0] - middle.x)))
    log = np.log(np.maximum(cell.picture(int(times[nearest])), 1))
    pitch = cell.settings.scene.dot_pitch_mm * 1e-3
    px = cell.camera.fx / cell.path.height_m
    half = int(pitch / 2 * px)
    found = []
    for dot in (d for d in range(6) if middle.mask >> d & 1):
        x, y = middle.x + (dot // 3 - 0.5) * pitch, middle.y + (1 - dot % 3) * pitch
        u = round(cell.camera.cx + (x - places[nearest, 0]) * px)
        v = round(cell.camera.cy - (y - places[nearest, 1]) * px)
        found.append(float(np.ptp(log[v - half : v + half + 1, u - half : u + half + 1])))
    return float(np.median(found))


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
