"""What a node says of its health on /diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from . import qos

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR


class Diagnostics:
    """Publishes one status a second, and at once when a fault is reported.

    Parameters
    ----------
    node : Node
        Whose health it is.
    part : str
        Name of the part; the status is called ``<node>: <part>``.
    values : callable
        Gives (level, message, values) of the regular status.
    """

    def __init__(
        self,
        node: Node,
        part: str,
        values: Callable[[], tuple[bytes, str, Mapping[str, object]]],
        period_s: float = 1.0,
    ) -> None:
        self._node = node
        self._name = f"{node.get_name()}: {part}"
        self._values = values
        self._fault = ""
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS)
        node.create_timer(period_s, self.publish)

    def fault(self, message: str) -> None:
        """Report a fault now; it stays in the next regular status too."""
        if message != self._fault:
            self._node.get_logger().warning(message)
            self._fault = message
            self._send(ERROR, message, {})

    def publish(self) -> None:
        """Publish the regular status."""
        level, message, values = self._values()
        if self._fault:
            level, message, self._fault = ERROR, self._fault, ""
        self._send(level, message, values)

    def _send(self, level: bytes, message: str, values: Mapping[str, object]) -> None:
        status = DiagnosticStatus(
            level=level,
            name=self._name,
            message=message,
            hardware_id="",
            values=[KeyValue(key=str(k), value=str(v)) for k, v in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
