"""Playing a scan to a graph: it begins when all listen, so that nobody misses the begin."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

from pydantic import Field
from rclpy.node import NodeNameNonExistentError

from roller_core.settings import Settings

from .diagnostics import STEADY
from .node import RollerNode
from .work_left import WorkLeft

#: How long no subscriber may have come before a scan begins, s: the other side needs a moment to
#: know of the publisher, and a node subscribes to its topics one by one. DDS tells of an endpoint
#: again after a second, where what told of it was lost.
SETTLE_S = 1.5
#: Time others have at least to finish before the node that played ends, s; for how long none may
#: have said that work is left; and how long they have at most.
LINGER_S, QUIET_S, MOST_S = 4.0, 2.5, 120.0
#: What any node may subscribe to before it is ready.
_ALL_HAVE = frozenset({"/clock", "/parameter_events"})


class PlaySettings(Settings):
    """How a node plays a scan to the graph."""

    rate: float = Field(1.0, ge=0.001, le=1000.0, description="Pace; 1 is real time.")
    subscribers: int = Field(1, ge=0, le=100, description="Subscribers to events to wait for.")
    listeners: str = Field(
        "",
        description="Nodes of the same namespace to wait for until they listen, with commas "
        "between.",
    )
    wait_s: float = Field(
        180.0,
        ge=0.0,
        le=600.0,
        description="Longest wait for them, s: on a first run nodes compile their kernels.",
    )
    exit_when_done: bool = Field(
        False,
        description="Whether to end after the last message, once no other node of the namespace "
        "says that it has work left.",
    )

    @property
    def listener_names(self) -> tuple[str, ...]:
        """The nodes, one by one."""
        return tuple(name for word in self.listeners.split(",") if (name := word.strip()))


class Publisher(Protocol):
    """What is needed of a publisher."""

    topic_name: str

    def get_subscription_count(self) -> int:
        """Subscriptions that it reaches."""


class Graph(Protocol):
    """What is needed of the node that plays."""

    def get_namespace(self) -> str:
        """Where it is."""

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> list[tuple[str, list[str]]]:
        """Topics that another listens to."""


def wait_for_listeners(
    node: Graph,
    events: Publisher,
    settings: PlaySettings,
    stop: threading.Event,
    tell: Callable[[str], None] = lambda _: None,
) -> str:
    """Wait until all listen who should, and then until no more come.

    Parameters
    ----------
    node : Node
        The one that plays.
    events : Publisher
        Of the event packets.
    settings : PlaySettings
        Who is waited for, and how long at most.
    stop : threading.Event
        Ends the waiting.
    tell : callable
        Told whom it waits for, whenever that changes.

    Returns
    -------
    str
        What to report if not all came in time; else empty.
    """
    now = time.monotonic()
    end, changed, before = now + settings.wait_s, now, None
    while not stop.is_set():
        count = events.get_subscription_count()
        missing = [name for name in settings.listener_names if not _listens(node, name)]
        now = time.monotonic()
        if (count, missing) != before:
            before, changed = (count, missing), now
            who = ", ".join(missing) or f"subscribers of {events.topic_name}"
            tell(f"waiting for {who}: on a first run they compile their kernels")
        complete = count >= settings.subscribers and not missing
        if complete and now - changed >= SETTLE_S:
            return ""
        if now > end + SETTLE_S:
            if complete:
                return ""
            found = f"{events.topic_name} {count} of {settings.subscribers}"
            found += f"; nothing of {', '.join(missing)}" if missing else ""
            return (
                f"not all subscribers came in {settings.wait_s:g} s ({found}); "
                "it begins without them"
            )
        stop.wait(0.05)
    return ""


def _listens(node: Graph, name: str) -> bool:
    """Whether a node subscribes: ours do so when all else is ready."""
    try:
        found = node.get_subscriber_names_and_types_by_node(name, node.get_namespace())
    except NodeNameNonExistentError:
        return False
    return any(topic not in _ALL_HAVE for topic, _ in found)


class PlayingNode(RollerNode):
    """A node that plays a scan from a thread of its own."""

    _p: PlaySettings

    def __init__(self, name: str, state: str) -> None:
        super().__init__(name)
        self._state, self._late_s, self._code = state, 0.0, 0
        self._stop, self._done = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def _start(self, run: Callable[[], None]) -> None:
        """Begin to play; the process ends with `_code` once `_done` is set."""
        self._others = WorkLeft(self) if self._p.exit_when_done else None
        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()
        self._timer = self.create_timer(0.2, self._end, clock=STEADY)

    def destroy_node(self) -> None:
        """Stop playing first: it publishes."""
        self._stop.set()
        if self._thread is not None:  # else the node gave up before it had one
            self._thread.join(timeout=5.0)
        super().destroy_node()

    def _wait_for_listeners(self, events: Publisher) -> None:
        def tell(state: str) -> None:
            self._state = state

        if missing := wait_for_listeners(self, events, self._p, self._stop, tell):
            self.get_logger().warning(missing)

    def _wait_until(self, due_s: float) -> None:
        """Wait until a time of the monotonic clock, s, or note by how much it is too late."""
        wait_s = due_s - time.monotonic()
        if wait_s > 0:
            self._stop.wait(wait_s)
        else:
            self._late_s = max(self._late_s, -wait_s)

    def _finish(self) -> None:
        """All was played: end when the others are done, if at all."""
        self._state = "finished"
        others, end_s = self._others, time.monotonic() + MOST_S
        if others is None or self._stop.wait(LINGER_S):
            return
        while others.quiet_s < QUIET_S:
            if time.monotonic() > end_s:
                self.get_logger().warning(
                    f"{others.who} still has work left after {MOST_S:.0f} s; it ends without it"
                )
                break
            if self._stop.wait(0.1):
                return
        self._done.set()

    def _end(self) -> None:
        if self._done.is_set():
            raise SystemExit(self._code)
