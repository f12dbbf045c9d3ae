"""Node `event_camera`: the DVXplorer Mini's events as ROS messages; a drop-in for libcaer_driver.

A lifecycle node: configured it has read its parameters and calibration, active it holds the camera
and streams. A camera that is missing, busy or unplugged is no reason to end: the node says so on
/diagnostics and goes on when it is there.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from event_camera_msgs.msg import EventPacket
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

from roller_core.camera import Camera
from roller_core.clock import SensorClock
from roller_core.codecs import encode
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_driver.dvxplorer.backends import load_backend
from roller_driver.dvxplorer.camera_info import load_camera_info
from roller_driver.dvxplorer.camera_settings import BIASES
from roller_driver.dvxplorer.device import CameraDevice
from roller_driver.dvxplorer.discovery import open_camera
from roller_driver.dvxplorer.errors import CameraFault
from roller_driver.dvxplorer.node_settings import EventCameraParameters
from roller_driver.dvxplorer.packets import EventPart
from roller_driver.dvxplorer.preview import Preview
from roller_ros import diagnostics, messages, qos
from roller_ros.backlog import Backlog
from roller_ros.node import RollerNode
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings
from roller_ros.worker import Worker, end_process

from .dvxplorer import protocol, reader

_OK, _FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
_NEVER_S = 1e9
#: Most events of a packet: above 400 kB, with 8 bytes an event at worst, a DDS set up as usual
#: loses messages.
_PACKET_EVENTS = 47_500
#: Packets that may wait to be sent.
_MOST_WAITING = 1000
#: Pause between rates in the log, s.
_STATISTICS_S = 10.0


class EventCameraNode(RollerNode, LifecycleNode):
    """Publishes what the camera sends."""

    def __init__(self) -> None:
        super().__init__("event_camera")
        self._p = declare_settings(self, EventCameraParameters, BIASES)
        self.add_on_set_parameters_callback(self._set_biases)
        self._reader: reader.CameraReader | None = None
        self._worker: Worker[tuple[int, EventPart]] | None = None
        self._outputs: dict[str, Any] = {}
        self._camera: Camera | None = None
        self._backend: Any = None
        self._preview = Preview()
        self._watched = self._shut_down = False
        self._clock_map = SensorClock()
        self._growth = diagnostics.Growth()
        self._sequence = 0
        self._sent = 0
        self._dropped = 0
        self._meter, self._log_meter = diagnostics.Meter(), diagnostics.Meter()
        self._error: RollerError | None = None
        self._diagnostics = diagnostics.Diagnostics(self, "camera", self._status)
        self.create_timer(_STATISTICS_S, self._print_statistics)
        if self._p.image_rate > 0:
            self.create_timer(1.0 / self._p.image_rate, self._publish_image)
        if self._p.autostart:
            self.trigger_configure()
            if self._error is not None:
                raise self._error
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the calibration and make the publishers."""
        p = self._p
        try:
            self._backend = load_backend(p.backend)
            self._camera = load_camera_info(p.camerainfo_url) if p.camerainfo_url else None
        except RollerError as error:
            self._error = error
            self.get_logger().error(str(error))
            return _FAILURE
        self._error = None
        # Compiles the encoder before the first event waits for it.
        warm = EventArray.from_arrays([0, 1], [0, 0], [0, 1000], [0, 1])
        encode(p.encoding, warm, 0)
        self._preview.add(warm)
        self._preview.take()
        self._outputs = {
            "events": self.create_lifecycle_publisher(EventPacket, "~/events", qos.EVENTS),
            "info": self.create_lifecycle_publisher(CameraInfo, "~/camera_info", qos.LATCHED),
            "image": self.create_lifecycle_publisher(Image, "~/image_raw", qos.PREVIEW),
        }
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to look for the camera and to stream."""
        result = super().on_activate(state)
        self._outputs["info"].publish(self._camera_info())
        self._worker = Worker(self._publish, lambda: None, _NEVER_S, Backlog(_MOST_WAITING))
        self._reader = reader.CameraReader(
            self._connect,
            self._take_packet,
            on_events=self._take_events,
            on_change=self._on_change,
            on_failure=end_process,
            settings=reader.ReaderSettings(
                round(self._p.event_message_time_threshold * 1e9), _PACKET_EVENTS
            ),
            clock_ns=self._now_ns,
        )
        self._reader.start()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the stream and let go of the camera."""
        self._halt()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the publishers away."""
        for publisher in self._outputs.values():
            self.destroy_publisher(publisher)
        self._outputs = {}
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, whatever the state; no transition leads on from here."""
        self._halt()
        self._shut_down = True
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Let go of the camera first."""
        if hasattr(self, "_worker"):  # else the node gave up before it could have one
            self._halt()
        super().destroy_node()

    def _halt(self) -> None:
        if self._reader is not None:
            self._reader.stop()
            self._reader = None
        if self._worker is not None:
            self._worker.drain(1.0)
            self._worker.stop()
            self._dropped += self._worker.backlog.dropped
            self._worker = None

    def _set_biases(self, parameters: Sequence[Parameter[Any]]) -> SetParametersResult:
        """Biases that are changed while it runs, on the camera too; it keeps them if unplugged."""
        values = {item.name: item.value for item in parameters if item.name in BIASES}
        try:
            wanted = self._p.changed(values)
            if values and self._reader is not None:
                self._reader.set_biases(wanted)
        except RollerError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._p = wanted
        return SetParametersResult(successful=True)

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _connect(self) -> CameraDevice:
        camera = open_camera(self._backend, self._p.serial)
        try:
            camera.configure(self._p)
        except CameraFault:
            camera.close()
            raise
        if camera.ignored:
            self._diagnostics.fault(f"{camera.name}: {camera.ignored}", diagnostics.WARN)
        # Plugged in again it counts from zero.
        self._clock_map.restart()
        return camera

    def _on_change(self, state: str, fault: str) -> None:
        if fault:
            self._diagnostics.fault(fault)
        else:
            self.get_logger().info(f"camera: {state}")

    def _take_events(self, events: EventArray) -> None:
        if self._watched:
            self._preview.add(events)

    def _take_packet(self, part: EventPart) -> None:
        self._clock_map.observe(part.time_base_ns, part.arrival_ns)
        if self._worker is not None and self._outputs["events"].get_subscription_count():
            # Counted before the queue: what is dropped there leaves a gap that others can see.
            self._worker.submit((self._sequence, part))
            self._sequence += 1

    def _publish(self, item: tuple[int, EventPart]) -> None:
        sequence, part = item
        base = part.time_base_ns
        payload = messages.payload(encode(self._p.encoding, part.events, base))
        packet = EventPacket(
            header=messages.header(part.arrival_ns, self._p.camera_frame_id),
            height=protocol.HEIGHT,
            width=protocol.WIDTH,
            seq=sequence,
            time_base=base,
            encoding=self._p.encoding,
            is_bigendian=False,
            events=payload,
        )
        self._outputs["events"].publish(packet)
        self._sent += 1

    def _publish_image(self) -> None:
        output = self._outputs.get("image")
        watched = output is not None and output.get_subscription_count() > 0
        if output is not None and watched and self._watched and self._reader is not None:
            picture = self._preview.take()
            output.publish(messages.image(picture, self._now_ns(), self._p.camera_frame_id))
        self._watched = watched

    def _camera_info(self) -> CameraInfo:
        if self._camera is not None:
            return messages.camera_info(self._camera, self._now_ns(), self._p.camera_frame_id)
        return CameraInfo(
            header=messages.header(self._now_ns(), self._p.camera_frame_id),
            width=protocol.WIDTH,
            height=protocol.HEIGHT,
            p=np.zeros(12),
        )

    def _print_statistics(self) -> None:
        if self._reader is None:
            return
        s = self._reader.status
        rates = self._log_meter.rates(events=s.decoder.events, bytes=s.usb.bytes, packets=s.packets)
        self.get_logger().info(
            f"{rates['events'] / 1e6:.3f} Mev/s, {rates['bytes'] / 1e6:.2f} MB/s over USB, "
            f"{rates['packets']:.0f} packets/s, {s.decoder.errors} decode errors since the start"
        )

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        if self._shut_down:
            return diagnostics.ERROR, "shut down: start the node again", {}
        if self._reader is None:
            return diagnostics.OK, "inactive", {}
        s = self._reader.status
        self._diagnostics.hardware_id = s.camera
        rates = self._meter.rates(
            events=s.decoder.events, bytes=s.usb.bytes, packets=s.packets,
            faults=s.decoder.errors + s.usb.overruns,
        )  # fmt: skip
        queue, dropped = 0, self._dropped
        if self._worker is not None:
            queue, dropped = self._worker.waiting, dropped + self._worker.backlog.dropped
        return (
            *self._health(s, rates["faults"] > 0, dropped),
            {
                "state": s.state,
                "camera": s.camera,
                "firmware": s.firmware,
                "event_rate_mev_s": f"{rates['events'] / 1e6:.3f}",
                "usb_mb_s": f"{rates['bytes'] / 1e6:.2f}",
                "packet_rate_hz": f"{rates['packets']:.0f}",
                "packets_sent": self._sent,
                "queue": queue,
                "packets_dropped": dropped,
                "connects": s.connects,
                "lost_references": s.decoder.lost_references,
                "dropped_frames": s.decoder.dropped_frames,
                "decode_errors": s.decoder.errors,
                "clock_resets": s.decoder.time_steps,
                "usb_stalls": s.usb.stalls,
                "usb_overruns": s.usb.overruns,
                **diagnostics.clock_figures(self._clock_map),
            },
        )

    def _health(self, s: reader.ReaderStatus, faults: bool, dropped: int) -> tuple[bytes, str]:
        """The worst that is the matter."""
        jumped = self._growth.of("clock steps", self._clock_map.steps) > 0
        lost = self._growth.of("dropped packets", dropped)
        if s.state == reader.SEARCHING:
            return diagnostics.ERROR, s.fault or "looking for the camera"
        if simulated := diagnostics.simulated_clock(self):
            return diagnostics.ERROR, simulated
        if s.state == reader.SILENT:
            return diagnostics.WARN, s.fault
        if jumped:
            return diagnostics.WARN, "streaming; the camera's clock has jumped"
        if faults:
            return diagnostics.WARN, "streaming, with faults of the stream"
        if lost > 0:
            return diagnostics.WARN, f"streaming, but {lost} packets had to be dropped"
        if self._camera is None:
            return diagnostics.WARN, "streaming, not calibrated: set camerainfo_url"
        return diagnostics.OK, s.state


def main() -> None:
    """Run the node."""
    sys.exit(run_node(EventCameraNode))
