"""Node `braille`: event packets and poses in, Braille cells and text out."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from event_camera_msgs.msg import EventPacket
from pydantic import Field
from rclpy.node import Node
from roller_msgs.msg import BrailleCell
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

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

from .cells import Cell
from .messages import cell_markers, cell_message, text_message
from .pipeline import BraillePipeline
from .settings import BrailleSettings

#: Packets kept while the camera's calibration hasn't come.
_MOST_EARLY = 5000


class BrailleParameters(BrailleSettings, FollowedFrames):
    """Parameters of the node: the reader's settings and the graph's frames."""

    idle_flush_s: float = Field(
        1.0,
        ge=0.05,
        le=60.0,
        description="Without events for this long all that is in view is read, s.",
    )


class BrailleNode(Node):
    """Translates messages into calls of `BraillePipeline` and its cells into messages."""

    def __init__(self) -> None:
        super().__init__("braille")
        p = declare_settings(self, BrailleParameters)
        self._parameters = p
        self._settings = BrailleSettings.create(
            {name: getattr(p, name) for name in BrailleSettings.model_fields}
        )
        self._frames = SensorFrames(
            p.base_frame, p.moving_frame, p.sensor_frame, p.max_pose_gap_s, p.pose_smoothing
        )
        self._stream: EventStream | None = None
        self._pipeline: BraillePipeline | None = None
        self._early: deque[EventPacket] = deque(maxlen=_MOST_EARLY)
        self._faults = 0
        self._latency_s = 0.0
        self._events_before = 0
        #: Text of pipelines before a restart, and all markers.
        self._earlier: list[str] = []
        self._text: list[str] = []
        self._markers: list[Marker] = []
        self._cells = self.create_publisher(BrailleCell, "/roller/braille/cells", qos.BRAILLE)
        self._texts = self.create_publisher(String, "/roller/braille/text", qos.BRAILLE)
        self._shown = self.create_publisher(MarkerArray, "/roller/braille/markers", qos.MARKERS)
        self._diagnostics = diagnostics.Diagnostics(self, "text", self._status)
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
        self._earlier = list(self._text)
        self._pipeline = BraillePipeline(self._settings, camera, self._frames.track)
        self._stream = EventStream(camera.width, camera.height)
        while self._early:
            try:
                self._take_packet(self._early.popleft())
            except RollerError as error:
                self._fault(error)

    def _take_packet(self, message: EventPacket) -> None:
        if self._stream is None or self._pipeline is None:
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
        self._earlier = list(self._text)
        if self._pipeline is not None:
            camera = self._pipeline.camera
            self._pipeline = BraillePipeline(self._settings, camera, self._frames.track)

    def _flush(self) -> None:
        try:
            self._frames.finish()
            self._publish_results(flush=True)
        except RollerError as error:
            self._fault(error)

    def _publish_results(self, flush: bool = False) -> None:
        pipeline = self._pipeline
        if pipeline is None:
            return
        cells = list(pipeline.results(flush))
        for cell in cells:
            self._publish(cell)
        if cells:
            self._text = [*self._earlier, *pipeline.text()]
            self._texts.publish(text_message(self._text))
            self._shown.publish(MarkerArray(markers=self._markers))
            now = self.get_clock().now().nanoseconds
            self._latency_s = (now - cells[-1].stamp_ns) * 1e-9
        for reason in pipeline.refusals:
            self._faults += 1
            self._diagnostics.fault(reason)
        pipeline.refusals.clear()
        needed = pipeline.needed_from_ns
        if needed is not None and len(self._frames.track):
            self._frames.track.discard_before(needed)

    def _publish(self, cell: Cell) -> None:
        frame = self._parameters.base_frame
        self._cells.publish(cell_message(cell, frame, len(self._earlier)))
        number = len(self._markers) // 2
        self._markers += cell_markers(cell, number, frame, self._settings.spacing)

    def _fault(self, error: RollerError) -> None:
        self._faults += 1
        self._diagnostics.fault(str(error))

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        pipeline, stream_of = self._pipeline, self._stream
        if pipeline is None or stream_of is None:
            return diagnostics.WARN, "waiting for /event_camera/camera_info", {}
        counts, stream = pipeline.counts, stream_of.counts
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
        recent = list(pipeline.milliseconds)[-1000:]
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
                "still_events": counts.still_events,
                "frames": counts.frames,
                "refused_frames": counts.refused_frames,
                "frame_ms_median": _percentile(recent, 50),
                "frame_ms_p95": _percentile(recent, 95),
                "cells": counts.cells,
                "unreadable_cells": counts.unreadable_cells,
                "repeated_cells": counts.repeated_cells,
                "cell_latency_s": round(self._latency_s, 4),
                "waiting_messages": self._worker.waiting,
                "waiting_events": pipeline.held_events,
                "faults": self._faults,
            },
        )


def _percentile(values: list[float], share: float) -> float:
    return round(float(np.percentile(values, share)), 2) if values else 0.0


def main() -> None:
    """Run the node."""
    sys.exit(run_node(BrailleNode))
