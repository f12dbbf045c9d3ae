"""Whether other nodes have work left, by what they say of themselves."""

from __future__ import annotations

import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from roller_core import outputs

from . import qos

#: What statuses call it: messages that wait; whether all that came is processed to the end. And
#: what only those of nodes have that take events.
_WAITING, _IDLE, _OF_EVENTS = "waiting_messages", "idle", "packets"
#: Who has said nothing for so long is gone, s.
_GONE_S = 3.0
#: So long a result may be on its way to the node that takes it, s.
_ON_THE_WAY_S = 0.1


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
        self._heard: dict[str, tuple[float, bool]] = {}
        self._rounds: list[Round] = []
        #: Who said last that work is left.
        self.who = ""
        node.create_subscription(DiagnosticArray, outputs.DIAGNOSTICS, self.take, qos.DIAGNOSTICS)

    @property
    def quiet_s(self) -> float:
        """For how long nobody has said that messages wait, s."""
        return self._clock_s() - self._busy_s

    def ask(self) -> Round:
        """Ask all nodes that were heard lately whether what came by now is processed."""
        now_s = self._clock_s()
        self._heard = {k: v for k, v in self._heard.items() if now_s - v[0] < _GONE_S}
        self._rounds = [one for one in self._rounds if one.open]
        self._rounds.append(Round({name: events for name, (_, events) in self._heard.items()}))
        return self._rounds[-1]

    def take(self, message: DiagnosticArray) -> None:
        """Take what nodes say."""
        now_s = self._clock_s()
        for status in message.status:
            cell, _, name = status.name.partition(":")[0].rpartition("/")
            values = {item.key: item.value for item in status.values}
            ours = f"{cell}/".lstrip("/") == self._cell and not status.name.startswith(self._own)
            if not ours or _WAITING not in values:
                continue
            busy, idle = values[_WAITING] != "0", values.get(_IDLE)
            if busy:
                self._busy_s, self.who = now_s, name
            if idle is not None:  # else it processes nothing
                self._heard[name] = now_s, _OF_EVENTS in values
                for one in self._rounds:
                    one.take(name, busy or idle == "0", now_s)


class Round:
    """What nodes say since they were asked: first those that take events, then the others.

    Parameters
    ----------
    asked : dict
        The nodes, and whether they take events.
    """

    def __init__(self, asked: dict[str, bool]) -> None:
        self._asked = asked
        self._done_s: dict[str, float] = {}
        #: Whether anybody still waits for it.
        self.open = True

    @property
    def unfinished(self) -> str:
        """The nodes that have work left, or haven't said; empty: none."""
        return ", ".join(name for name in self._asked if name not in self._done_s)

    def take(self, name: str, busy: bool, now_s: float) -> None:
        """Take what a node says."""
        events = [other for other, first in self._asked.items() if first]
        first = self._asked.get(name)
        if busy:
            self._done_s.pop(name, None)
        elif first:
            self._done_s.setdefault(name, now_s)
        elif first is not None and all(other in self._done_s for other in events):
            since_s = max((self._done_s[other] for other in events), default=-1e9)
            if now_s >= since_s + _ON_THE_WAY_S:
                self._done_s.setdefault(name, now_s)
