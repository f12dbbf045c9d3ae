"""Whether other nodes have work left, by what they say of themselves."""

from __future__ import annotations

import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from . import qos

#: What statuses call it.
_KEY = "waiting_messages"


class WorkLeft:
    """Listens to the statuses of the nodes of a namespace.

    Parameters
    ----------
    node : Node
        The one that listens; what it says itself doesn't count.
    clock_s : callable
        Monotonic time, s.
    """

    def __init__(self, node: Node, clock_s: Callable[[], float] = time.monotonic) -> None:
        own = node.get_fully_qualified_name().lstrip("/")
        self._cell, self._own = own.removesuffix(node.get_name()), f"{own}:"
        self._clock_s = clock_s
        self._busy_s = clock_s()
        #: Who said last that work is left.
        self.who = ""
        node.create_subscription(DiagnosticArray, "/diagnostics", self.take, qos.DIAGNOSTICS)

    @property
    def quiet_s(self) -> float:
        """For how long nobody has said that work is left, s."""
        return self._clock_s() - self._busy_s

    def take(self, message: DiagnosticArray) -> None:
        """Take what nodes say."""
        for status in message.status:
            cell, _, name = status.name.partition(":")[0].rpartition("/")
            ours = f"{cell}/".lstrip("/") == self._cell and not status.name.startswith(self._own)
            waiting = {item.key: item.value for item in status.values}.get(_KEY, "0")
            if ours and waiting != "0":
                self._busy_s, self.who = self._clock_s(), name
