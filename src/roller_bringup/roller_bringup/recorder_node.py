"""Node `recorder`: the graph's topics into a rosbag2 (MCAP)."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from pydantic import Field
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rosbags.interfaces import Qos
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError

from roller_core.bags import bag_qos, typestore
from roller_core.errors import UnwritableOutputError
from roller_core.settings import Settings
from roller_ros import diagnostics
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings
from roller_ros.worker import Worker

from . import topics


class RecorderParameters(Settings):
    """Parameters of the node."""

    output: str = Field("recording", description="Bag folder to write; must not exist yet.")
    queue: int = Field(
        50_000,
        ge=10,
        le=10_000_000,
        description="Messages that may wait for the disk; beyond it the oldest are dropped, "
        "counted and reported.",
    )


class RecorderNode(Node):
    """Writes every message as it came, with the time it came."""

    def __init__(self) -> None:
        super().__init__("recorder")
        p = declare_settings(self, RecorderParameters)
        path = Path(p.output)
        if path.exists():
            raise UnwritableOutputError(f"{path}: is there already; give another output")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (OSError, WriterError) as error:
            raise UnwritableOutputError(f"{path}: can't be written ({error})") from error
        store = typestore()
        self._connections = {
            t.name: self._writer.add_connection(
                t.name, t.type_name, typestore=store, offered_qos_profiles=_offered(t)
            )
            for t in topics.ALL
        }
        self._written: Counter[str] = Counter()
        self._diagnostics = diagnostics.Diagnostics(self, "recording", self._status)
        self._worker: Worker[tuple[str, int, bytes]] = Worker(
            self._write, lambda: None, 3600.0, p.queue
        )
        for t in topics.ALL:
            self.create_subscription(
                t.type, t.name, lambda data, name=t.name: self._take(name, data), t.qos, raw=True
            )

    def destroy_node(self) -> None:
        """Write what waits and finish the bag."""
        if hasattr(self, "_worker"):  # else the node gave up before it had one
            self._worker.drain(4.0)
            self._worker.stop()
            self._writer.close()
        super().destroy_node()

    def _take(self, name: str, data: bytes) -> None:
        self._worker.submit((name, self.get_clock().now().nanoseconds, data))

    def _write(self, item: tuple[str, int, bytes]) -> None:
        name, t_ns, data = item
        try:
            self._writer.write(self._connections[name], t_ns, data)
        except OSError as error:
            self._diagnostics.fault(f"the bag can't be written: {error.strerror}; disk full?")
            return
        self._written[name] += 1

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        lost = self._worker.dropped
        level = diagnostics.ERROR if lost else diagnostics.OK
        message = f"{lost} messages lost: the disk is too slow" if lost else "recording"
        return level, message, {**self._written, "waiting": self._worker.waiting, "lost": lost}


def _offered(topic: topics.Topic) -> list[Qos]:
    return bag_qos(
        topic.qos.depth,
        topic.qos.reliability == ReliabilityPolicy.RELIABLE,
        topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(RecorderNode))
