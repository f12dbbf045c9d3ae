"""The virtual cell: a roller with an event camera over a plate."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.events import EventArray

from . import _sensor_kernels as kernels
from ._render_kernels import trace_scratch
from .cell_settings import MotionSettings, VirtualCellSettings
from .motion import PACKET_LATENCY_US, START_SENSOR_NS, Path, PoseStream, hand_eye, make_camera
from .optics import SurfaceMaps, light_vector, to_grey
from .relief import F64, HeightMap, Scene
from .scenes import build_scene
from .sensor import EventSensor, unpack
from .skin import press_depth_mm, skin_over
from .truth import Truth

#: Frames simulated at a stretch.
_CHUNK = 32
_IMAGE_LATENCY_NS = 3_000_000
_MAP_MARGIN_MM = 0.5
#: Travel between rendered frames, px, and the longest time between them, s.
_STEP_PX, _MAX_STEP_S = 0.5, 1e-3
#: RMS of the coating's reflectance, in contrast thresholds, from which flat plate gives events too.
_PRINTED = 0.2
#: Longest packet, ns, and the mean of what delays one beyond the least, µs.
_PACKET_NS, _ARRIVAL_JITTER_US = 1_000_000, 80.0
#: Most events of a packet.
_PACKET_EVENTS = 48_000


@dataclass(frozen=True)
class Packet:
    """Events as they come from the camera."""

    #: Number of the packet.
    seq: int
    #: The header's stamp: arrival of the first event at the host, ROS time.
    stamp_ns: int
    #: Sensor time the packet begins at.
    time_base_ns: int
    #: When the whole packet is there, ROS time.
    arrival_ns: int
    #: Events in sensor time.
    events: EventArray


@dataclass(frozen=True)
class PoseSample:
    """One reported pose of tool0_controller in base: metres and quaternion x, y, z, w."""

    stamp_ns: int
    arrival_ns: int
    position: F64
    quaternion: F64


@dataclass(frozen=True)
class Picture:
    """One intensity image, uint8, shape (height, width)."""

    stamp_ns: int
    arrival_ns: int
    image: npt.NDArray[np.uint8]


Item = Packet | PoseSample | Picture


class VirtualCell:
    """A simulated scan, the same each time for the same settings.

    Parameters
    ----------
    settings : VirtualCellSettings
        What to roll over, how fast, with what sensor.

    Raises
    ------
    UnknownSceneError, SceneError, VirtualCellError
        If it can't be set up as asked.
    """

    def __init__(self, settings: VirtualCellSettings) -> None:
        self.scene: Scene = build_scene(settings.scene)
        self.camera: Camera = make_camera(settings.camera)
        radius = settings.camera.roller_radius_mm
        press = press_depth_mm(settings.skin, self.scene.press_mm)
        table = self.camera.undistortion_table().reshape(-1, 2)
        rays = self.camera.rays(table).reshape(self.camera.height, self.camera.width, 3)
        self._rays = (
            np.ascontiguousarray(rays[..., 0], np.float32),
            np.ascontiguousarray(rays[..., 1], np.float32),
        )
        reach_x, reach_y = (float(np.abs(r).max()) * (radius - press) for r in self._rays)
        self.settings = settings.model_copy(
            update={"motion": _with_ends(settings, self.scene, reach_x)}
        )
        path = Path(self.settings.motion, (radius - press) * 1e-3, settings.seed)
        relief = _cover(self.scene.relief, path, reach_x, reach_y)
        self.skin: HeightMap = skin_over(relief, settings.skin)
        #: What is known exactly about this scan.
        self.truth = Truth(
            self.settings, press, self.skin, relief,
            self.scene.regions, self.scene.text, self.scene.marks,
            tuple(mark.followed(self.skin) for mark in self.scene.defects),
        )  # fmt: skip
        self.path: Path = self.truth.path
        self.hand_eye: F64 = hand_eye()
        self.poses = PoseStream.record(self.path, settings.clock, settings.seed)
        self._maps = SurfaceMaps.build(self.skin, settings.light, settings.seed)
        widest = float(np.hypot(*self._rays).max()) * radius
        self._light = light_vector(settings.light, widest)
        #: Share of the scan simulated so far, 0 to 1.
        self.progress = 0.0
        #: Events read out so far, and those the rate cap has cut.
        self.event_count = 0
        self.dropped_count = 0

    @property
    def duration_s(self) -> float:
        """Length of the scan with its standstills."""
        return self.path.duration_s

    @property
    def travel_px(self) -> float:
        """Length of the stretch at full speed in pixels of the plate's face."""
        m = self.settings.motion
        assert m.start_mm is not None
        assert m.end_mm is not None
        return abs(m.end_mm - m.start_mm) / self._px_mm

    @property
    def _px_mm(self) -> float:
        return self.path.height_m * 1e3 / self.camera.fx

    def sensor_to_ros_ns(self, elapsed_ns: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """True ROS time of sensor time counted from the start."""
        rate = 1.0 + self.settings.clock.drift_ppm * 1e-6
        return self.truth.start_ros_ns + np.round(np.asarray(elapsed_ns) / rate).astype(np.int64)

    def raw_events(self) -> Iterator[tuple[int, EventArray]]:
        """Events chunk by chunk: sensor time simulated so far (from the start), events up to it.

        Times of the events count from the start as well.
        """
        s = self.settings.sensor
        rate = 1.0 + self.settings.clock.drift_ppm * 1e-6
        true_s = self.path.frame_times(_STEP_PX * self._px_mm * 1e-3, _MAX_STEP_S)
        times = np.round(true_s * rate * 1e9).astype(np.int64)
        cameras = self.path.over_plate(true_s) * 1e3
        sensor = EventSensor(
            self._rays, self._maps, self.truth.roller, self._light, s, self.settings.seed,
            self.settings.threads, self.settings.light.speckle >= _PRINTED * s.threshold,
        )  # fmt: skip
        sensor.start(cameras[0])
        for a in range(1, len(times), _CHUNK):
            words = sensor.advance(cameras[a : a + _CHUNK], times[a : a + _CHUNK])
            now = int(times[min(a + _CHUNK, len(times)) - 1])
            self.progress = now / int(times[-1])
            self.event_count, self.dropped_count = sensor.count, sensor.dropped
            yield now, EventArray(*unpack(words))

    def run(self) -> Iterator[Item]:
        """Everything the cell's devices send, in order of arrival at the host."""
        known: list[Item] = [*self._pose_items(), *self._picture_stubs()]
        queue = [(item.arrival_ns, i, item) for i, item in enumerate(known)]
        heapq.heapify(queue)
        order = len(known)
        packets = _Packer(self)
        for now, events in self.raw_events():
            for packet in packets.add(events, now):
                heapq.heappush(queue, (packet.arrival_ns, order, packet))
                order += 1
            # What arrives later than a packet still being filled has to wait for it.
            horizon = int(self.sensor_to_ros_ns(packets.open_since(now)))
            while queue and queue[0][0] < horizon:
                yield self._developed(heapq.heappop(queue)[2])
        for packet in packets.flush():
            heapq.heappush(queue, (packet.arrival_ns, order, packet))
            order += 1
        while queue:
            yield self._developed(heapq.heappop(queue)[2])

    def picture(self, t_ros_ns: int) -> npt.NDArray[np.uint8]:
        """The intensity image at a ROS time, uint8, shape (height, width)."""
        camera = (self.truth.camera_positions(t_ros_ns)[0] - self.truth.origin_m) * 1e3
        shape = self._rays[0].shape
        depth = np.full(shape, camera[2], np.float32)
        sx, sy, out = (np.empty(shape, np.float32) for _ in range(3))
        kernels._render_rows(
            *self._rays, self._maps.flat, self._maps.shape, camera, self.truth.roller,
            self._maps.origin, self._light, trace_scratch(shape[1]), depth, sx, sy, out,
        )  # fmt: skip
        return to_grey(out, self.settings.light)

    def _developed(self, item: Item) -> Item:
        if isinstance(item, Picture):
            return Picture(item.stamp_ns, item.arrival_ns, self.picture(item.stamp_ns))
        return item

    def _pose_items(self) -> list[PoseSample]:
        p = self.poses
        return [
            PoseSample(int(s), int(a), x, q)
            for s, a, x, q in zip(p.stamp_ns, p.arrival_ns, p.position, p.quaternion, strict=True)
        ]

    def _picture_stubs(self) -> list[Picture]:
        hz = self.settings.clock.image_rate_hz
        if hz <= 0:
            return []
        empty = np.empty((0, 0), np.uint8)
        times = self.truth.start_ros_ns + np.arange(0, self.truth.duration_ns, round(1e9 / hz))
        return [Picture(int(t), int(t) + _IMAGE_LATENCY_NS, empty) for t in times]


def _with_ends(settings: VirtualCellSettings, scene: Scene, reach_mm: float) -> MotionSettings:
    """Motion settings with start and end: objects come into view at full speed and leave so."""
    motion = settings.motion
    x0, x1, _, _ = scene.relief.bounds
    first = min((r.x0 for r in scene.regions), default=x0) * 1e3 - reach_mm - _MAP_MARGIN_MM
    last = max((r.x1 for r in scene.regions), default=x1) * 1e3 + reach_mm + _MAP_MARGIN_MM
    if not scene.regions:
        first, last = x0 * 1e3, x1 * 1e3
    if settings.scene.length_mm * 1e-3 > x1 - x0 - scene.relief.step:  # longer than its objects
        last = max(last, x1 * 1e3)
    return motion.model_copy(
        update={
            "start_mm": first if motion.start_mm is None else motion.start_mm,
            "end_mm": last if motion.end_mm is None else motion.end_mm,
        }
    )


def _cover(relief: HeightMap, path: Path, reach_x: float, reach_y: float) -> HeightMap:
    """The relief, made larger with flat plate to cover all that the camera sees."""
    x0, x1 = path.x_range_m
    dx, dy = (reach_x + 2 * _MAP_MARGIN_MM) * 1e-3, (reach_y + 2 * _MAP_MARGIN_MM) * 1e-3
    return relief.padded(x0 - dx, x1 + dx, -dy, dy)


class _Packer:
    """Cuts the stream of events into packets."""

    def __init__(self, cell: VirtualCell) -> None:
        self._cell = cell
        self._span = _PACKET_NS
        self._rest = EventArray.empty()
        self._rng = np.random.default_rng([cell.settings.seed, 23])
        self._seq = 0
        self._arrival = 0

    def open_since(self, now: int) -> int:
        """Sensor time from which on packets may still come."""
        return now // self._span * self._span

    def add(self, events: EventArray, now: int) -> Iterator[Packet]:
        """Packets that are complete at a sensor time, both counted from the start."""
        events = EventArray.concatenate([self._rest, events])
        cut = int(np.searchsorted(events.t_ns, self.open_since(now)))
        self._rest = events[cut:]
        yield from self._cut(events[:cut])

    def flush(self) -> Iterator[Packet]:
        """The rest."""
        yield from self._cut(self._rest)
        self._rest = EventArray.empty()

    def _cut(self, events: EventArray) -> Iterator[Packet]:
        if not len(events):
            return
        window = events.t_ns // self._span
        edges = np.flatnonzero(np.diff(window)) + 1
        for a, b in zip([0, *edges], [*edges, len(events)], strict=True):
            for start in range(int(a), int(b), _PACKET_EVENTS):
                yield self._packet(events[start : min(start + _PACKET_EVENTS, int(b))])

    def _packet(self, events: EventArray) -> Packet:
        delay = round((PACKET_LATENCY_US + self._rng.exponential(_ARRIVAL_JITTER_US)) * 1e3)
        first, last = self._cell.sensor_to_ros_ns([events.t_ns[0], events.t_ns[-1]])
        self._arrival = max(self._arrival, int(last) + delay)
        self._seq += 1
        start = int(events.t_ns[0])
        return Packet(
            self._seq - 1,
            int(first) + delay,
            START_SENSOR_NS + start,
            self._arrival,
            events.shifted(START_SENSOR_NS),
        )
