"""What a node says of its health on /diagnostics."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from roller_core import outputs
from roller_core.clock import SensorClock
from roller_core.sensor_pose import PoseCounts

from . import qos

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR

#: For timers that go on where the node's clock is a simulated one, which may stand.
STEADY = Clock(clock_type=ClockType.STEADY_TIME)

#: More than this only the newest is reported, with the regular status.
_MOST_FAULTS_A_SECOND = 10


class Growth:
    """By how much counts have grown since each was asked for last."""

    def __init__(self) -> None:
        self._before: dict[str, int] = {}

    def of(self, name: str, now: int) -> int:
        """Growth of a count; of a new one all of it."""
        before, self._before[name] = self._before.get(name, 0), now
        return now - before


class Meter:
    """Rates from counts that only grow."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._at = clock_s()
        self._last: dict[str, float] = {}

    def rates(self, **counts: float) -> dict[str, float]:
        """How much each count grew a second since the last call, under the same names.

        What counts from zero again, and what is new, is taken as grown from zero.
        """
        now = self._clock_s()
        seconds = max(now - self._at, 1e-6)
        before = {k: v if v <= counts.get(k, v) else 0.0 for k, v in self._last.items()}
        self._at, self._last = now, dict(counts)
        return {k: round((v - before.get(k, 0.0)) / seconds, 1) for k, v in counts.items()}


def clock_figures(clock: SensorClock) -> dict[str, object]:
    """What all statuses say of a map from a device's clock to ROS time."""
    return {
        "clock_residual_us": round(clock.residual_s * 1e6),
        "clock_scatter_us": round(clock.scatter_s * 1e6),
        "clock_skew_ppm": round(clock.skew * 1e6, 1),
        "clock_steps": clock.steps,
    }


def pose_figures(counts: PoseCounts) -> dict[str, object]:
    """What all statuses say of the robot's poses."""
    return {
        "poses": counts.poses,
        "pose_gaps": counts.gaps,
        "longest_pose_gap_s": round(counts.longest_gap_s, 3),
        "pose_jumps": counts.jumps,
    }


def simulated_clock(node: Node) -> str:
    """What is wrong with a device's node that goes by a simulated clock; empty: it doesn't."""
    if not node.get_clock().ros_time_is_active:
        return ""
    return "use_sim_time is set, but a device's times are this machine's: set it to false here"


class Diagnostics:
    """Publishes one status a second, and at once when a fault is reported.

    Parameters
    ----------
    node : Node
        Whose health it is.
    part : str
        Name of the part; the status is called ``<node>: <part>``, the node with its namespace.
    values : callable
        Gives (level, message, values) of the regular status.
    period_s : float
        Time between two regular statuses, s.
    hardware_id : str
        The device, or the frame of the camera, that it is of.
    """

    def __init__(
        self,
        node: Node,
        part: str,
        values: Callable[[], tuple[bytes, str, Mapping[str, object]]],
        period_s: float = 1.0,
        hardware_id: str = "",
    ) -> None:
        self.hardware_id = hardware_id
        self._node = node
        self._period_s = period_s
        self._name = f"{node.get_fully_qualified_name().lstrip('/')}: {part}"
        self._values = values
        self._fault, self._fault_level = "", ERROR
        self._reported_s: list[float] = []
        self._publisher = node.create_publisher(
            DiagnosticArray, outputs.DIAGNOSTICS, qos.DIAGNOSTICS
        )
        node.create_timer(period_s, self.publish, clock=STEADY)

    @contextmanager
    def preparing(self, what: str) -> Iterator[None]:
        """Say what a node does that takes long before it spins, in place of regular statuses."""
        done, begun = threading.Event(), time.monotonic()

        def say() -> None:
            while not done.wait(self._period_s):
                self._send(WARN, f"{what} ({time.monotonic() - begun:.0f} s)", {})

        thread = threading.Thread(target=say, name="preparing", daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()

    def fault(self, message: str, level: bytes = ERROR) -> None:
        """Report a fault now; it stays in the next regular status too.

        A flood of faults is reported ten times a second. Until that status an error isn't
        followed by a warning.
        """
        if message == self._fault or (self._fault and level < self._fault_level):
            return
        self._fault, self._fault_level = message, level
        now = time.monotonic()
        self._reported_s = [at for at in self._reported_s if now - at < 1.0]
        if len(self._reported_s) < _MOST_FAULTS_A_SECOND:
            self._reported_s.append(now)
            self._node.get_logger().warning(message)
            self._send(level, message, {})

    def publish(self) -> None:
        """Publish the regular status."""
        level, message, values = self._values()
        if self._fault:
            if self._fault_level >= level:
                level, message = self._fault_level, self._fault
            self._fault = ""
        self._send(level, message, values)

    def _send(self, level: bytes, message: str, values: Mapping[str, object]) -> None:
        status = DiagnosticStatus(
            level=level,
            name=self._name,
            message=message,
            hardware_id=self.hardware_id,
            values=[KeyValue(key=str(k), value=str(v)) for k, v in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
