"""One publisher of a topic is followed where several publish it; the others are left out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

from rclpy.node import Node

#: Silence after which another publisher is followed, and for which a conflict is remembered, s.
_SILENCE_S = 0.5
_REMEMBERED_S = 3.0
#: Silence after which a node that was started again is followed, although the dead one is still in
#: the graph, s.
_SUCCESSION_S = 2.0
#: In place of a node's name that isn't known yet.
_UNKNOWN = "_NODE_NAME_UNKNOWN_"
#: Bytes of a publisher's id that tell it from others; the graph's ids may be longer.
_ID = 16
#: Of these, those that tell its process (DDS: its participant) from others.
_PROCESS = 12


def publisher_of(info: Mapping[str, Any]) -> bytes | None:
    """Who sent a message, by rclpy's `MessageInfo`; None where that isn't said."""
    gid = info.get("publisher_gid")
    return None if gid is None else bytes(gid["data"])[:_ID]


def info_of(sender: bytes, t_ns: int) -> dict[str, Any]:
    """Rclpy's `MessageInfo` of a message that is kept without it, as far as a source needs it."""
    return {"publisher_gid": {"data": sender} if sender else None, "received_timestamp": t_ns}


class OneSource:
    """Keeps to one publisher where several send.

    Two that don't agree would make a surface of neither. The first is followed until it is silent.

    Parameters
    ----------
    latched : bool
        The topic's publishers may send once and be silent ever after: the first is followed until
        it is gone from the graph (`keep_to`).
    clock_s : callable
        Monotonic time, s.
    processes : bool
        Processes are told apart, not publishers: what one sends on several topics is one source.

    Attributes
    ----------
    followed : bytes or None
        The publisher; None before the first message.
    foreign : int
        Messages of others, left out.
    """

    def __init__(
        self,
        latched: bool = False,
        clock_s: Callable[[], float] = time.monotonic,
        processes: bool = False,
    ) -> None:
        self._silence_s, self._remembered_s = (
            (math.inf, math.inf) if latched else (_SILENCE_S, _REMEMBERED_S)
        )
        self._length = _PROCESS if processes else _ID
        self._clock_s = clock_s
        self._heard_s = self._taken_s = 0.0
        self._others: dict[bytes, float] = {}
        self.followed: bytes | None = None
        self.foreign = 0

    def accepts(self, info: Mapping[str, Any]) -> bool:
        """Whether to take a message.

        Parameters
        ----------
        info : mapping
            rclpy's `MessageInfo`; where it doesn't tell the publisher, all are taken.
        """
        sender = publisher_of(info)
        if sender is None:
            return True
        sender = sender[: self._length]
        # When it arrived, not when it was looked at: a node that was busy heard nobody.
        at_s = info.get("received_timestamp", 0) * 1e-9 or self._clock_s()
        if sender != self.followed:
            if self.followed is not None and abs(at_s - self._heard_s) < self._silence_s:
                self._others[sender] = self._clock_s()
                self.foreign += 1
                return False
            self.follow(sender)
        self._heard_s, self._taken_s = at_s, self._clock_s()
        return True

    def follow(self, sender: bytes | None) -> None:
        """Follow a publisher from now on; with None the next one."""
        self.followed = sender
        if sender is not None:
            self._others.pop(sender, None)

    def keep_to(self, alive: Collection[bytes], whole: Sequence[Collection[bytes]] = ()) -> None:
        """Forget publishers that are gone.

        Parameters
        ----------
        alive : collection of bytes
            Those that publish now.
        whole : sequence of collection of bytes
            Of each topic that is needed, its publishers: who was heard first but sends only some
            of them isn't followed any longer where another sends all.
        """
        alive = {sender[: self._length] for sender in alive}
        self._others = {k: t for k, t in self._others.items() if k in alive}
        parts = [{sender[: self._length] for sender in senders} for senders in whole]
        complete: set[bytes] = set.intersection(*parts) if parts else set()
        if self.followed not in alive:
            self.follow(None)
        elif complete and self.followed not in complete:
            self.follow(min(complete))

    def keep_to_name(self, names: Mapping[bytes, str]) -> None:
        """Follow a publisher of the same name that sends while the followed one is silent.

        Parameters
        ----------
        names : mapping
            Of those that publish now, the full names of their nodes.
        """
        names = {sender[: self._length]: name for sender, name in names.items()}
        name = names.get(self.followed or b"")
        if name is None or name.endswith(_UNKNOWN):
            return
        for sender, at_s in self._others.items():
            if names.get(sender) == name and at_s - self._taken_s > _SUCCESSION_S:
                self.follow(sender)
                return

    def conflict(self, node: Node, topics: Iterable[str], what: str, cure: str) -> str:
        """What to tell of publishers that don't agree; empty: there is but one.

        Parameters
        ----------
        node : Node
            Knows the graph.
        topics : iterable of str
            Where they publish.
        what, cure : str
            What they publish, and what to do, for people.
        """
        now = self._clock_s()
        self._others = {k: t for k, t in self._others.items() if now - t < self._remembered_s}
        if not self._others or self.followed is None:
            return ""
        names = {
            bytes(info.endpoint_gid): f"/{info.node_name}"
            for topic in topics
            for info in node.get_publishers_info_by_topic(topic)
        }
        first = _name(names, self.followed)
        others = ", ".join(sorted(_name(names, sender) for sender in self._others))
        return f"{first} and {others} publish {what}; {first} is followed: {cure}"


def publishers(node: Node, *topics: str) -> dict[bytes, str]:
    """Those that publish some topics now, as `publisher_of` tells them; full names of the nodes."""
    return {
        bytes(info.endpoint_gid)[:_ID]: f"{info.node_namespace.rstrip('/')}/{info.node_name}"
        for topic in topics
        for info in node.get_publishers_info_by_topic(topic)
    }


def same_process(a: bytes | None, b: bytes | None) -> bool:
    """Whether two publishers are of one process (DDS: of one participant)."""
    return a is not None and b is not None and a[:_PROCESS] == b[:_PROCESS]


def _name(names: Mapping[bytes, str], gid: bytes) -> str:
    found: Iterable[str] = (n for k, n in names.items() if k.startswith(gid))
    return next(iter(found), "a node that is gone")
