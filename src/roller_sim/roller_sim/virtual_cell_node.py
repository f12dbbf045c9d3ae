"""Node `virtual_cell`: a simulated camera and robot in place of the real ones."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import TransformStamped
from pydantic import Field
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

from roller_core.codecs import encode
from roller_core.errors import UnwritableOutputError
from roller_core.frame_settings import RobotFrames
from roller_core.outputs import CAMERA_INFO as INFO
from roller_core.outputs import EVENTS, TF, TF_STATIC, stamp_ns
from roller_core.outputs import PREVIEW as IMAGE
from roller_core.pose_track import Pose
from roller_core.transforms import matrix_to_quaternion
from roller_ros import diagnostics, messages, topics
from roller_ros.listeners import PlayingNode, PlaySettings
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings

from .cell import Item, Packet, PoseSample, VirtualCell
from .cell_settings import VirtualCellSettings
from .truth import Truth
from .truth_files import save_maps, save_text


class VirtualCellParameters(PlaySettings, VirtualCellSettings, RobotFrames):
    """Parameters of the node: the cell's settings and how the scan is played."""

    prepare: bool = Field(
        True, description="Simulate all of the scan before it starts; else while it runs."
    )
    truth_output: str = Field(
        "", description="Folder to write the scan's truth to when it starts; empty: nowhere."
    )


class VirtualCellNode(PlayingNode):
    """Simulates a scan and publishes what camera and robot would, at the pace they would."""

    _p: VirtualCellParameters

    def __init__(self) -> None:
        super().__init__("virtual_cell", "preparing")
        self._p = p = declare_settings(self, VirtualCellParameters)
        self._cell = VirtualCell(
            VirtualCellSettings.create({n: getattr(p, n) for n in VirtualCellSettings.model_fields})
        )
        # Not _publishers: rclpy's own.
        self._outputs: dict[str, Publisher] = {
            topic.name: topics.publisher(self, topic.name) for topic in topics.INPUTS
        }
        self._packets = self._sent = self._poses = 0
        self._meter = diagnostics.Meter()
        self._diagnostics = diagnostics.Diagnostics(self, "scan", self._status, 0.5, p.sensor_frame)
        self._publish_fixed()
        self._start(self._run)

    def _publish_fixed(self) -> None:
        now = self.get_clock().now().nanoseconds
        info = messages.camera_info(self._cell.camera, now, self._p.sensor_frame)
        self._outputs[INFO].publish(info)
        fixed = self._cell.hand_eye
        pose = Pose(fixed[:3, 3], matrix_to_quaternion(fixed[:3, :3]))
        transform = messages.transform(pose, now, self._p.tool, self._p.sensor_frame)
        self._outputs[TF_STATIC].publish(TFMessage(transforms=[transform]))

    def _run(self) -> None:
        try:
            stream = self._messages()
            if self._p.prepare:
                stream = iter(list(stream))
            self._save_truth(save_maps, self._cell.truth)
            self._wait_for_listeners(self._outputs[EVENTS])
            if not self._stop.is_set():
                self._scan(stream)
        except Exception as error:  # a thread that dies unseen would leave all others waiting
            if self._stop.is_set():
                return  # the node is gone, what was being published could not be
            print(f"error: {error}", file=sys.stderr, flush=True)
            self._diagnostics.fault(str(error))
            self._state, self._code = "failed", 1
            self._done.set()
            return
        self._finish()

    def _messages(self) -> Iterator[tuple[int, str, Any, int]]:
        """Arrival, topic, message and number of events of all that the cell sends."""
        for item in self._cell.run():
            if self._stop.is_set():
                return
            events = len(item.events) if isinstance(item, Packet) else 0
            yield (item.arrival_ns, *self._message(item), events)

    def _message(self, item: Item) -> tuple[str, Any]:
        if isinstance(item, Packet):
            encoding = self._cell.settings.packets.encoding
            data = messages.payload(encode(encoding, item.events, item.time_base_ns))
            return EVENTS, EventPacket(
                header=messages.header(item.stamp_ns, self._p.sensor_frame),
                height=self._cell.camera.height,
                width=self._cell.camera.width,
                seq=item.seq,
                time_base=item.time_base_ns,
                encoding=encoding,
                is_bigendian=False,
                events=data,
            )
        if isinstance(item, PoseSample):
            pose = Pose(item.position, item.quaternion)
            transform = messages.transform(pose, item.stamp_ns, self._p.base, self._p.tool)
            return TF, TFMessage(transforms=[transform])
        return IMAGE, messages.image(item.image, item.stamp_ns, self._p.sensor_frame)

    def _scan(self, stream: Iterator[tuple[int, str, Any, int]]) -> None:
        self._state = "scanning"
        start = self._cell.truth.start_ros_ns
        # Time stamps are those of a scan that begins now.
        shift = self.get_clock().now().nanoseconds - start
        begin = time.monotonic()
        self._save_truth(save_text, self._cell.truth.starting_at(start + shift))
        for arrival, topic, message, events in stream:
            if self._stop.is_set():
                return
            self._wait_until(begin + (arrival - start) * 1e-9 / self._p.rate)
            holder: EventPacket | Image | TransformStamped = (
                message.transforms[0] if topic == TF else message
            )
            stamp = stamp_ns(holder) + shift
            holder.header.stamp = messages.to_time(stamp)
            self._outputs[topic].publish(message)
            self._packets += topic == EVENTS
            self._poses += topic == TF
            self._sent += events

    def _save_truth(self, save: Callable[[Truth, Path], None], truth: Truth) -> None:
        if not self._p.truth_output:
            return
        folder = Path(self._p.truth_output)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            save(truth, folder)
        except OSError as error:
            raise UnwritableOutputError(
                f"{folder}: can't write the truth there ({error})"
            ) from error

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        level = diagnostics.OK
        rates = self._meter.rates(packets=self._packets, events=self._sent, poses=self._poses)
        if self._cell.dropped_count:
            level = diagnostics.WARN
        return (
            level,
            self._state,
            {
                "scene": self._cell.settings.scene.name,
                "simulated": f"{100 * self._cell.progress:.0f} %",
                "packet_rate_hz": rates["packets"],
                "event_rate_mev_s": round(rates["events"] * 1e-6, 3),
                "pose_rate_hz": rates["poses"],
                "packets": self._packets,
                "events": self._cell.event_count,
                "events_over_rate_cap": self._cell.dropped_count,
                "behind_real_time_s": f"{self._late_s:.3f}",
            },
        )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(VirtualCellNode))
