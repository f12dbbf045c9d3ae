"""Node `emvs`: event packets and poses in, depth maps out."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from event_camera_msgs.msg import EventPacket
from pydantic import Field
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from roller_core.errors import RollerError
from roller_core.event_stream import EventStream, TimeBackwardsError
from roller_core.frames import SensorFrames
from roller_core.pose_track import PoseOrderError
from roller_ros import diagnostics, messages, qos
from roller_ros.frames_settings import FollowedFrames
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings
from roller_ros.tf import take_transforms
from roller_ros.worker import Worker

from .depth_map import DepthMap, pinhole
from .pipeline import DepthPipeline
from .settings import DepthSettings
from .windows import RefusedWindow


class EmvsParameters(DepthSettings, FollowedFrames):
    """Parameters of the node: the depth engine's settings and the graph's frames."""

    idle_flush_s: float = Field(
        1.0,
        ge=0.05,
        le=60.0,
        description="Without events for this long the last, incomplete window is processed, s.",
    )


class EmvsNode(Node):
    """Translates messages into calls of `DepthPipeline` and its results into messages."""

    def __init__(self) -> None:
        super().__init__("emvs")
        p = declare_settings(self, EmvsParameters)
        self._parameters = p
        self._settings = DepthSettings.create(
            {name: getattr(p, name) for name in DepthSettings.model_fields}
        )
        self._frames = SensorFrames(
            p.base_frame, p.moving_frame, p.sensor_frame, p.max_pose_gap_s, p.pose_smoothing
        )
        self._stream: EventStream | None = None
        self._pipeline: DepthPipeline | None = None
        self._early: list[EventPacket] = []
        self._faults = 0
        self._latency_s = 0.0
        self._window_ms: deque[float] = deque(maxlen=1000)
        self._events_before = 0
        self._image = self.create_publisher(Image, "/roller/depth/image", qos.DEPTH)
        self._confidence = self.create_publisher(Image, "/roller/depth/confidence", qos.DEPTH)
        self._info = self.create_publisher(CameraInfo, "/roller/depth/camera_info", qos.DEPTH)
        self._diagnostics = diagnostics.Diagnostics(self, "depth", self._status)
        self._worker: Worker[Any] = Worker(self._handle, self._flush, p.idle_flush_s, 20_000)
        submit = self._worker.submit
        self.create_subscription(EventPacket, "/event_camera/events", submit, qos.EVENTS)
        self.create_subscription(CameraInfo, "/event_camera/camera_info", submit, qos.LATCHED)
        self.create_subscription(TFMessage, "/tf", lambda m: submit(("tf", m), False), qos.TF)
        self.create_subscription(
            TFMessage, "/tf_static", lambda m: submit(("static", m), False), qos.TF_STATIC
        )

    def destroy_node(self) -> None:
        """Stop the worker first: it publishes."""
        if hasattr(self, "_worker"):  # else the node gave up before it had one
            self._worker.stop()
        super().destroy_node()

    def _handle(self, item: EventPacket | CameraInfo | tuple[str, TFMessage]) -> None:
        try:
            if isinstance(item, EventPacket):
                self._take_packet(item)
            elif isinstance(item, CameraInfo):
                self._take_camera(item)
            elif isinstance(item, tuple):
                take_transforms(self._frames, item[1], item[0] == "static", self._pose_fault)
            self._publish_results()
        except RollerError as error:
            self._fault(error)

    def _take_camera(self, message: CameraInfo) -> None:
        camera = messages.camera_from_info(message)
        if self._pipeline is not None and self._pipeline.camera == camera:
            return
        self._pipeline = DepthPipeline(self._settings, camera, self._frames.track)
        self._stream = EventStream(camera.width, camera.height)
        early, self._early = self._early, []
        for packet in early:
            self._take_packet(packet)

    def _take_packet(self, message: EventPacket) -> None:
        if self._stream is None or self._pipeline is None:
            if len(self._early) == 5000:
                self._early.pop(0)
            self._early.append(message)
            return
        try:
            events = self._stream.push(
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
        self._pipeline.add_events(events)

    def _pose_fault(self, error: RollerError) -> None:
        if isinstance(error, PoseOrderError) and error.behind_s > 1.0:
            self._restart(error)
        else:
            self._fault(error)

    def _restart(self, reason: RollerError) -> None:
        """Finish what there is and begin anew: the source was started again."""
        self._fault(reason)
        self._flush()
        self._frames.restart()
        if self._pipeline is not None:
            camera = self._pipeline.camera
            self._pipeline = DepthPipeline(self._settings, camera, self._frames.track)

    def _flush(self) -> None:
        self._frames.finish()
        self._publish_results(flush=True)

    def _publish_results(self, flush: bool = False) -> None:
        if self._pipeline is None:
            return
        for found in self._pipeline.results(flush):
            if isinstance(found, RefusedWindow):
                self._diagnostics.fault(
                    f"window at {found.start_ns * 1e-9:.3f} s gives no depth: {found.reason}"
                )
            else:
                self._publish(found)
        needed = self._pipeline.needed_from_ns
        if needed is not None and len(self._frames.track):
            self._frames.track.discard_before(needed)

    def _publish(self, found: DepthMap) -> None:
        assert self._pipeline is not None
        t, frame = found.stamp_ns, self._parameters.sensor_frame
        camera = pinhole(self._pipeline.camera)
        self._info.publish(messages.camera_info(camera, t, frame))
        self._confidence.publish(messages.image(found.confidence, t, frame))
        self._image.publish(messages.image(found.depth, t, frame))
        self._window_ms.append(found.milliseconds.get("total", 0.0))
        self._latency_s = self.get_clock().now().nanoseconds * 1e-9 - found.end_ns * 1e-9

    def _fault(self, error: RollerError) -> None:
        self._faults += 1
        self._diagnostics.fault(str(error))

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        if self._pipeline is None or self._stream is None:
            return diagnostics.WARN, "waiting for /event_camera/camera_info", {}
        counts, stream = self._pipeline.counts, self._stream.counts
        rate = stream.events - self._events_before
        self._events_before = stream.events
        level, message = diagnostics.OK, "running"
        if not self._frames.has_robot_poses:
            level = diagnostics.WARN
            message = f"no poses {self._frames.base} -> {self._frames.moving} on /tf"
        elif self._frames.hand_eye is None:
            level = diagnostics.WARN
            message = f"no way {self._frames.moving} -> {self._frames.sensor} on /tf_static"
        elif stream.lost_packets or counts.dropped_events or self._worker.dropped:
            level, message = diagnostics.WARN, "data were lost"
        return (
            level,
            message,
            {
                "event_rate_per_s": rate,
                "events": stream.events,
                "lost_packets": stream.lost_packets,
                "late_events": stream.late_events,
                "events_outside_image": stream.outside_events,
                "dropped_events": counts.dropped_events,
                "dropped_messages": self._worker.dropped,
                "events_without_pose": counts.events_without_pose,
                "windows": counts.windows,
                "refused_windows": counts.refused_windows,
                "window_ms_median": _percentile(self._window_ms, 50),
                "window_ms_p95": _percentile(self._window_ms, 95),
                "window_latency_s": round(self._latency_s, 4),
                "waiting_messages": self._worker.waiting,
                "waiting_events": self._pipeline.held_events,
                "clock_residual_s": self._stream.clock.residual_s,
                "clock_skew_ppm": self._stream.clock.skew * 1e6,
                "clock_steps": stream.clock_steps,
                "faults": self._faults,
            },
        )


def _percentile(values: deque[float], share: float) -> float:
    return round(float(np.percentile(values, share)), 2) if values else 0.0


def main() -> None:
    """Run the node."""
    sys.exit(run_node(EmvsNode))
