"""A node that follows the event camera and the robot and drives a pipeline with them."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from event_camera_msgs.msg import EventPacket
from pydantic import Field
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

from roller_core.camera import Camera, OtherCameraError
from roller_core.clock import SensorClock
from roller_core.errors import RollerError
from roller_core.event_stream import EventStream, StreamCounts, TimeBackwardsError
from roller_core.events import EventArray
from roller_core.pose_track import PoseOrderError, PoseTrack
from roller_core.sensor_pose import SensorFrames

from . import diagnostics, messages, qos
from .draining import subscribe_draining
from .frames_settings import FollowedFrames
from .parameters import declare_settings
from .tf import PoseSources, take_transforms
from .worker import Worker

#: Packets kept while the camera's calibration hasn't come.
_MOST_EARLY = 5000
#: Messages that are taken without looking for results while more wait.
_MOST_UNPROCESSED = 10


class StreamParameters(FollowedFrames):
    """What every such node takes beside its pipeline's settings."""

    idle_flush_s: float = Field(
        1.0,
        ge=0.05,
        le=60.0,
        description="Without events for this long what is left is processed as it is, s.",
    )
    calibrated_camera: tuple[float, ...] = Field(
        (0.0,),
        description="Camera that the other parameters were calibrated with: width, height, fx, fy, "
        "cx, cy (px), distortion; with another the node refuses to go on. A single 0: any.",
    )


class Counts(Protocol):
    """What a pipeline counts."""

    dropped_events: int
    events_without_pose: int


class Pipeline(Protocol):
    """What the node needs of a pipeline."""

    camera: Camera

    @property
    def counts(self) -> Counts:
        """What was done and lost so far."""

    @property
    def held_events(self) -> int:
        """Events that wait."""

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed."""

    def add_events(self, events: EventArray) -> None:
        """Take events in order of time."""


P = TypeVar("P", bound=Pipeline)


class StreamNode(Node, Generic[P]):
    """Takes packets, calibration and transforms in order and hands events to a pipeline.

    All work is done in one thread in the order of arrival, so what comes out is what a replay of
    the same messages gives. Broken input is reported and left out; a source that starts anew is
    followed.

    Parameters
    ----------
    name : str
        Name of the node.
    part : str
        Name of its diagnostics.
    model : type
        Its parameters: `StreamParameters` and the pipeline's settings, with `max_pose_gap_s`.
    """

    def __init__(self, name: str, part: str, model: type[StreamParameters]) -> None:
        super().__init__(name)
        p: Any = declare_settings(self, model)
        self.parameters = p
        self.frames = SensorFrames(
            p.base_frame, p.moving_frame, p.sensor_frame, p.max_pose_gap_s, p.pose_smoothing
        )
        self.stream: EventStream | None = None
        self.pipeline: P | None = None
        self.faults = 0
        self._unprocessed = 0
        #: Why the camera isn't taken.
        self._refused = ""
        self._early: deque[EventPacket] = deque(maxlen=_MOST_EARLY)
        self._sources = PoseSources(p.base_frame, p.moving_frame)
        self._meter = diagnostics.Meter()
        self._steps_told = 0
        self.diagnostics = diagnostics.Diagnostics(self, part, self._status)
        self._worker: Worker[Any] = Worker(self._handle, self._flush, p.idle_flush_s, 20_000)

    def listen(self) -> None:
        """Subscribe; to be called when the node is complete."""
        submit = self._worker.submit
        subscribe_draining(self, EventPacket, "/event_camera/events", submit, qos.EVENTS)
        # Latched, as it should be, and as drivers have it that send it over and over.
        for quality in (qos.LATCHED, qos.REPEATED):
            self.create_subscription(
                CameraInfo, "/event_camera/camera_info", submit, quality,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )  # fmt: skip
        self.create_subscription(TFMessage, "/tf", self._take_tf, qos.EVERY_TF)
        self.create_subscription(
            TFMessage, "/tf_static", lambda m: submit(("static", m), False), qos.TF_STATIC
        )

    def _take_tf(self, message: TFMessage, info: Mapping[str, Any]) -> None:
        if self._sources.accepts(message, info):
            self._worker.submit(("tf", message), False)

    def destroy_node(self) -> None:
        """Stop the worker first: it publishes."""
        if hasattr(self, "_worker"):  # else the node gave up before it had one
            self._worker.stop()
        super().destroy_node()

    @abstractmethod
    def make_pipeline(self, camera: Camera, track: PoseTrack) -> P:
        """Begin with a camera, or begin anew."""

    @abstractmethod
    def publish_results(self, pipeline: P, flush: bool) -> None:
        """Publish what is complete; with `flush` all that is left."""

    @abstractmethod
    def figures(self, pipeline: P) -> Mapping[str, object]:
        """What the diagnostics say of the pipeline."""

    def fault(self, error: RollerError | str) -> None:
        """Report and count a fault."""
        self.faults += 1
        self.diagnostics.fault(str(error))

    def _handle(self, item: EventPacket | CameraInfo | tuple[str, TFMessage]) -> None:
        try:
            if isinstance(item, EventPacket):
                self._take_packet(item)
            elif isinstance(item, CameraInfo):
                self._take_camera(item)
            else:
                take_transforms(self.frames, item[1], item[0] == "static", self._pose_fault)
            # Results don't depend on when they are asked for, and asking costs.
            self._unprocessed += 1
            if self._worker.waiting <= 1 or self._unprocessed >= _MOST_UNPROCESSED:
                self._unprocessed = 0
                self._process()
        except RollerError as error:
            self.fault(error)

    def _take_camera(self, message: CameraInfo) -> None:
        camera = messages.camera_from_info(message)
        figures = self.parameters.calibrated_camera
        if any(figures) and not camera.same_intrinsics(figures):
            self.pipeline = self.stream = None
            self._refused = (
                f"the camera ({camera}) isn't the one that the node's parameters were "
                "calibrated with (calibrated_camera): calibrate again, or leave params:= away"
            )
            raise OtherCameraError(self._refused)
        self._refused = ""
        if self.pipeline is not None and self.pipeline.camera == camera:
            return
        self.pipeline = self.make_pipeline(camera, self.frames.track)
        self.stream = EventStream(camera.width, camera.height)
        while self._early:
            try:
                self._take_packet(self._early.popleft())
            except RollerError as error:
                self.fault(error)

    def _take_packet(self, message: EventPacket) -> None:
        if self.stream is None or self.pipeline is None:
            self._early.append(message)
            return
        try:
            events = self.stream.push(
                message.encoding,
                message.width,
                message.height,
                message.seq,
                messages.to_ns(message.header.stamp),
                message.time_base,
                message.events,
            )
        except TimeBackwardsError as error:
            self._restart(error)
            events = error.events
        self.pipeline.add_events(events)

    def _pose_fault(self, error: RollerError) -> None:
        if isinstance(error, PoseOrderError) and error.behind_s > 1.0:
            self._restart(error)
        else:
            self.fault(error)

    def _restart(self, reason: RollerError) -> None:
        """Finish what there is and begin anew: the source was started again."""
        self.fault(reason)
        self._flush()
        self.frames.restart()
        if self.pipeline is not None:
            self.pipeline = self.make_pipeline(self.pipeline.camera, self.frames.track)

    def _flush(self) -> None:
        try:
            self.frames.finish()
            self._process(flush=True)
        except RollerError as error:
            self.fault(error)

    def _process(self, flush: bool = False) -> None:
        if self.pipeline is None:
            return
        self.publish_results(self.pipeline, flush)
        needed = self.pipeline.needed_from_ns
        if needed is not None and len(self.frames.track):
            self.frames.track.discard_before(needed)

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        level, message = self._health()
        stream = self.stream.counts if self.stream is not None else StreamCounts()
        clock = self.stream.clock if self.stream is not None else SensorClock()
        frames = self.frames.counts
        rates = self._meter.rates(events=stream.events, packets=stream.packets, poses=frames.poses)
        figures: dict[str, object] = {
            "event_rate_per_s": rates["events"],
            "packet_rate_hz": rates["packets"],
            "pose_rate_hz": rates["poses"],
            "events": stream.events,
            "lost_packets": stream.lost_packets,
            "decode_errors": stream.decode_errors,
            "late_events": stream.late_events,
            "events_outside_image": stream.outside_events,
            "waiting_messages": self._worker.waiting,
            "dropped_messages": self._worker.dropped,
            **diagnostics.pose_figures(frames),
            "foreign_poses": self._sources.foreign,
            **diagnostics.clock_figures(clock),
            "faults": self.faults,
        }
        if self.pipeline is not None:
            counts = self.pipeline.counts
            figures |= {
                "dropped_events": counts.dropped_events,
                "events_without_pose": counts.events_without_pose,
                "waiting_events": self.pipeline.held_events,
                **self.figures(self.pipeline),
            }
        return level, message, figures

    def _health(self) -> tuple[bytes, str]:
        """The worst that is the matter."""
        if self._refused:
            return diagnostics.ERROR, self._refused
        if self.pipeline is None or self.stream is None:
            return diagnostics.WARN, "waiting for /event_camera/camera_info"
        frames, stream, steps = self.frames, self.stream.counts, self.stream.clock.steps
        jumped, self._steps_told = steps > self._steps_told, steps
        conflict = self._sources.conflict(self)
        if conflict:
            return diagnostics.ERROR, conflict
        if not frames.has_robot_poses:
            return diagnostics.WARN, f"no poses {frames.base} -> {frames.moving} on /tf"
        if frames.hand_eye is None:
            return diagnostics.WARN, f"no way {frames.moving} -> {frames.sensor} on /tf_static"
        cameras = self.count_publishers("/event_camera/events")
        if cameras > 1:
            return (
                diagnostics.ERROR,
                f"{cameras} nodes publish /event_camera/events: stop all but one",
            )
        if jumped:
            return (
                diagnostics.WARN,
                "the camera's clock has jumped against the host's; its map is started anew",
            )
        if stream.lost_packets or self.pipeline.counts.dropped_events or self._worker.dropped:
            return diagnostics.WARN, "data were lost"
        return diagnostics.OK, "running"


def percentile(values: Iterable[float], share: float) -> float:
    """Percentile of times for diagnostics; 0 while there are none."""
    found = list(values)
    return round(float(np.percentile(found, share)), 2) if found else 0.0
