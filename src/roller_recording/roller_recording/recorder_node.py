"""Node `recorder`: the graph's topics into a rosbag2 (MCAP)."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from roller_core import outputs
from roller_recording.raw_message import RawMessage
from roller_recording.writing.one_camera import OneCamera
from roller_recording.writing.polled_subscriptions import PolledSubscriptions
from roller_recording.writing.recorder_settings import RecorderParameters
from roller_ros import diagnostics, topics
from roller_ros.dds_profile import less_shared
from roller_ros.node import RollerNode
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings
from roller_ros.sources import publishers

from .writing import BagWriter, Recorder

#: How long the node writes what waits when it is asked to end, s. The launch file gives it 30
#: (`sigterm_timeout`).
_DRAIN_S = 25.0


class RecorderNode(RollerNode):
    """Writes every message as it came, with the time at which it arrived; of one camera.

    Parameters
    ----------
    **options
        Of `rclpy.node.Node`, such as `parameter_overrides`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("recorder", **options)
        p = declare_settings(self, RecorderParameters)
        chosen, enough = (
            [replace(t, name=self.resolve_topic_name(t.name)) for t in found]
            for found in (topics.recorded(raw, p.events_topic) for raw in (p.raw, True))
        )
        self.path = Path(p.output)
        self._needed = [t.name for t in enough if t.type is not topics.FORCE[0].type]
        writer = BagWriter(
            self.path,
            {t.name: (t.type_name, topics.offered(t)) for t in chosen},
            p.compress,
            int(p.keep_free_mb * 1e6),
        )
        events = self.resolve_topic_name(p.events_topic)
        self._camera_info = self.resolve_topic_name(
            topics.beside(outputs.CAMERA_INFO, p.events_topic)
        )
        self.recorder = Recorder(writer, [events], int(p.queue_mb * 1e6))
        self._camera = OneCamera(events, self._camera_info, self.recorder.losses)
        self._diagnostics = diagnostics.Diagnostics(self, "recording", self._status)
        self._reported = False
        self._polled = PolledSubscriptions(self, chosen, self._take, self._overflow)
        self.create_timer(1.0, self._look_round)

    def stop_taking(self) -> None:
        """Take what has arrived and no more; what waits is still being written."""
        self._polled.stop()

    def destroy_node(self) -> None:
        """Write what waits, finish the bag and say what was lost."""
        if hasattr(self, "_polled") and not self.recorder.stopped:
            self.stop_taking()
            self.recorder.drain(_DRAIN_S)
            self.recorder.stop()
            for line in self.faults():
                print(f"error: {line}", file=sys.stderr, flush=True)
        super().destroy_node()

    def faults(self) -> list[str]:
        """One line for each thing that went wrong so far."""
        recorder = self.recorder
        lines = [] if recorder.fault is None else [str(recorder.fault)]
        return lines + [f"lost: {line}" for line in recorder.losses.lines(recorder.start_ns)]

    def missing(self) -> list[str]:
        """Topics that a replay needs and on which nothing came so far."""
        seen = self.recorder.progress().messages
        return [name for name in self._needed if not seen.get(name)]

    def _take(self, messages: list[RawMessage]) -> None:
        self.recorder.take(self._camera.keep(messages))

    def _look_round(self) -> None:
        self._polled.match_publishers()
        self._camera.see_publishers(publishers(self, self._camera_info))

    def _overflow(self, topic: str, t_ns: int) -> None:
        self.recorder.losses.overflows[topic] += 1

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        recorder = self.recorder
        if recorder.fault is not None and not self._reported:
            self._reported = True
            self.get_logger().error(f"{recorder.fault}; recording has ended")
        p = recorder.progress()
        level, message = diagnostics.OK, "recording"
        if recorder.fault is not None:
            level, message = diagnostics.ERROR, str(recorder.fault)
        elif p.lost_here:
            level = diagnostics.ERROR
            message = f"{p.lost_here} messages not written: the disk is too slow"
        elif conflict := self._camera.conflict(self):
            level, message = diagnostics.ERROR, conflict
        elif p.lost_before:
            level = diagnostics.WARN
            message = f"{p.lost_before} event packets never came"
        return level, message, {
            **p.messages,
            "events": p.events,
            "lost_packets": p.lost_before,
            "seq_restarts": p.seq_restarts,
            "foreign_packets": p.foreign_packets,
            "lost_messages": p.lost_here,
            "waiting_messages": p.waiting_messages,
            "waiting_mb": round(p.waiting_bytes / 1e6, 1),
            "written_mb": round(p.bytes_written / 1e6, 1),
        }  # fmt: skip


def main() -> None:
    """Run the node."""
    sys.exit(run_node(less_shared(RecorderNode)))
