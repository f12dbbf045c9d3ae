"""Scans of the virtual cell with their truth, simulated once and kept."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
from joblib import Memory

from roller_core.camera import Camera
from roller_core.codecs import encode
from roller_core.digests import source_digest
from roller_core.errors import RollerError
from roller_core.event_stream import EventStream
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import matrix_to_quaternion
from roller_sim.cell import Packet, PoseSample, VirtualCell
from roller_sim.truth import Truth

from .cases import ScanCase

#: Travel over an object whose windows are compared: just over two windows of 12 mm, four of 6 mm,
#: or most of one of 28 mm, so that no rule leaves half a window over.
CROSSING_M = 0.0245


@dataclass(frozen=True)
class Scan:
    """A scan, held in memory."""

    #: The scene.
    name: str
    #: m/s.
    speed: float
    #: All events, ROS time.
    events: EventArray
    #: Where in `events` each packet ends.
    packet_ends: npt.NDArray[np.int64]
    #: Camera in base, as measured.
    track: PoseTrack
    #: Calibration.
    camera: Camera
    #: The truth.
    truth: Truth

    @property
    def packets(self) -> list[EventArray]:
        """Events packet by packet, as a node gets them."""
        starts = [0, *self.packet_ends[:-1].tolist()]
        return [self.events[a:b] for a, b in zip(starts, self.packet_ends.tolist(), strict=True)]

    @cached_property
    def even(self) -> EventArray:
        """Events while the camera goes at constant speed."""
        return between(self.events, *self._even_span())

    @cached_property
    def crossing(self) -> EventArray:
        """Events while the camera's axis is within half of `CROSSING_M` of the object's middle."""
        times = np.linspace(*self._even_span(), 2001).astype(np.int64)
        x = self.truth.camera_positions(times)[:, 0]
        region = self.truth.objects.get(self.name)
        middle = 0.5 * (region.x0 + region.x1) if region else float(x.mean())
        near = times[np.abs(x - middle) <= 0.5 * CROSSING_M]
        return between(self.even, int(near[0]), int(near[-1])) if len(near) else self.even

    def _even_span(self) -> tuple[int, int]:
        """ROS times between which the camera goes at constant speed."""
        first, last = self.truth.path.even_s
        start = self.truth.start_ros_ns
        return start + round(first * 1e9), start + round(last * 1e9)


def between(events: EventArray, start_ns: int, end_ns: int) -> EventArray:
    """Events from a time (included) to another (excluded)."""
    first, last = np.searchsorted(events.t_ns, [start_ns, end_ns])
    return events[int(first) : int(last)]


def simulate(case: ScanCase, threads: int = 1) -> Scan:
    """Roll the virtual cell over a scene, and read what it gives as a node reads it.

    Raises
    ------
    RollerError
        If a setting is no good or the scan holds no events.
    """
    cell = VirtualCell(case.settings(threads))
    frames = SensorFrames(smoothing=case.pose_smoothing)
    fixed = cell.hand_eye
    frames.add_static(
        frames.moving, frames.sensor, fixed[:3, 3], matrix_to_quaternion(fixed[:3, :3])
    )
    size = cell.camera.width, cell.camera.height
    stream, encoding = EventStream(*size), cell.settings.packets.encoding
    packets = []
    for item in cell.run():
        if isinstance(item, Packet):
            payload = encode(encoding, item.events, item.time_base_ns)
            packets.append(
                stream.push(encoding, *size, item.seq, item.stamp_ns, item.time_base_ns, payload)
            )
        elif isinstance(item, PoseSample):
            frames.add(frames.base, frames.moving, item.stamp_ns, item.position, item.quaternion)
    if not any(len(p) for p in packets):
        raise RollerError(f"{case.scene}: the scan holds no events")
    ends = np.cumsum([len(p) for p in packets], dtype=np.int64)
    events = EventArray.concatenate(packets)
    return Scan(case.scene, case.speed, events, ends, frames.track, cell.camera, cell.truth)


class ScanStore:
    """Scans by their settings, a few of them in memory.

    Parameters
    ----------
    folder : path, optional
        Where they are kept for other runs, by their settings and the simulator's source; several
        processes may share it. None: nowhere.
    hold : int
        How many are held in memory.
    threads : int
        Of the simulation.
    """

    def __init__(self, folder: Path | None = None, hold: int = 1, threads: int = 1) -> None:
        self._hold, self._threads = hold, threads
        self._held: OrderedDict[str, Scan] = OrderedDict()
        self._memory = Memory(folder, verbose=0)
        self._simulated = self._memory.cache(_simulated, ignore=["case", "threads"])

    def get(self, case: ScanCase) -> Scan:
        """A scan, simulated where it is neither held nor kept.

        Raises
        ------
        RollerError
            As `simulate`.
        """
        key = case.key
        if key not in self._held:
            source = source_digest("roller_core", "roller_sim")
            while len(self._held) >= self._hold:
                self._held.popitem(last=False)
            self._held[key] = self._simulated(key, source, case, self._threads)
        self._held.move_to_end(key)
        return self._held[key]


def _simulated(_key: str, _source: str, case: ScanCase, threads: int) -> Scan:
    return simulate(case, threads)
