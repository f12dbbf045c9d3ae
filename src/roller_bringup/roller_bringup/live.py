"""Running a launch file and knowing when its graph has nothing more to do."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Image

from roller_core import outputs
from roller_core.errors import RollerError
from roller_ros import qos, topics
from roller_ros.refusals import init_ros

from .launching import LaunchPlan, Runner

#: How long outputs must be quiet at the end, s; longer than the nodes' idle flush.
_QUIET_S = 3.0
#: Statuses that tell that the source has nothing more to send.
SOURCES = ("virtual_cell: scan", "player: playback")


class GraphError(RollerError):
    """The graph ended before its work was done."""


@dataclass
class Observation:
    """What was seen of a running graph."""

    #: Last diagnostics by status name: message and values.
    statuses: dict[str, tuple[str, dict[str, str]]] = field(default_factory=dict)
    #: Messages by output topic, without images.
    received: dict[str, int] = field(default_factory=dict)
    #: When the last of them came, by the monotonic clock, s.
    last_output: float = 0.0

    @property
    def source(self) -> str:
        """What the source says of itself; empty before it did."""
        return next((self.statuses[name][0] for name in SOURCES if name in self.statuses), "")

    @property
    def drained(self) -> bool:
        """Whether no node says that it has messages waiting, or a part or a window to end."""
        every = [values for _, values in self.statuses.values()]
        waiting = any(values.get("waiting_messages", "0") != "0" for values in every)
        return not waiting and all(values.get("idle", "1") == "1" for values in every)


class Observer:
    """A node of its own context that watches diagnostics and outputs; a context manager."""

    def __init__(self) -> None:
        self.seen = Observation()
        self._context = Context()
        init_ros(context=self._context)
        self._node = Node("observer", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        for topic in topics.OUTPUTS:
            # Of a depth map its camera tells: three megabytes more would be copied for nothing, on
            # cores that are busy with what they are to tell of.
            if topic.type not in (DiagnosticArray, Image):
                count = self._counter(topic.path)
                self._node.create_subscription(topic.type, topic.path, count, topic.qos, raw=True)
        self._node.create_subscription(
            DiagnosticArray, outputs.DIAGNOSTICS, self._diagnose, qos.DIAGNOSTICS
        )

    def spin(self, timeout_s: float) -> None:
        """Take what comes within some time."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=max(end - time.monotonic(), 0.0))

    def node_names(self) -> set[str]:
        """Names of the nodes seen by now, with their namespaces: `emvs`, `left/emvs`."""
        found = self._node.get_node_names_and_namespaces()
        return {f"{namespace}/{name}".strip("/") for name, namespace in found}

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        self.spin(0.3)  # Fast DDS can hang where one leaves while others do: see `RollerNode`
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _counter(self, name: str) -> Callable[[Any], None]:
        def count(_: Any) -> None:
            self.seen.received[name] = self.seen.received.get(name, 0) + 1
            self.seen.last_output = time.monotonic()

        return count

    def _diagnose(self, message: Any) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if values or status.name not in self.seen.statuses:
                self.seen.statuses[status.name] = (status.message, values)


def check_no_duplicate_nodes(plan: LaunchPlan, wait_s: float = 1.0) -> None:
    """See that no node of a plan runs already; two graphs with the same topics spoil each other.

    Parameters
    ----------
    plan : LaunchPlan
        What is to run.
    wait_s : float
        How long to listen for others, s.

    Raises
    ------
    GraphError
        If there is one.
    """
    with Observer() as observer:
        observer.spin(wait_s)
        there = sorted(observer.node_names() & {node.label for node in plan.processes})
    if there:
        domain = os.environ.get("ROS_DOMAIN_ID") or "0"
        raise GraphError(
            f"already running in ROS domain {domain}: {', '.join(there)}; stop them, or set "
            "ROS_DOMAIN_ID to another number (nodes that were killed are still listed for a minute)"
        )


def run_until_done(
    plan: LaunchPlan,
    timeout_s: float = 600.0,
    report: Callable[[str], None] = lambda line: None,
) -> Observation:
    """Run a graph until its source is finished and the outputs have been quiet for a while.

    Parameters
    ----------
    plan : LaunchPlan
        What to run.
    timeout_s : float
        Give up after this, s.
    report : callable
        Takes a line about what is going on.

    Raises
    ------
    GraphError
        If a required node ended or time ran out.
    """
    with Observer() as observer, Runner(plan) as runner:
        seen, begin, source = observer.seen, time.monotonic(), ""
        done_at = None
        while True:
            observer.spin(0.1)
            now = time.monotonic()
            if seen.source != source:
                source = seen.source
                report(f"source: {source}")
            if source == "finished":
                done_at = done_at or now
                if now - max(seen.last_output, done_at) > _QUIET_S and seen.drained:
                    return seen
            if runner.poll() is not None:
                ended = (f"{name} exited with {code}" for name, code in runner.exit_codes.items())
                raise GraphError(f"the graph ended early: {', '.join(ended)}")
            if now - begin > timeout_s:
                raise GraphError(f"the graph was not done after {timeout_s:.0f} s")
