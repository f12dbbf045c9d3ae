"""Playing a scan to a graph: it begins when all listen, so that nobody misses the begin."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Protocol

from pydantic import Field

from roller_core.settings import Settings

#: How long no subscriber may have come before a scan begins, s: the other side needs a moment to
#: know of the publisher, and a node subscribes to its topics one by one.
SETTLE_S = 1.0
#: Time others have to finish before the node that played ends, s.
LINGER_S = 4.0


class PlaySettings(Settings):
    """How a node plays a scan to the graph."""

    rate: float = Field(1.0, ge=0.001, le=1000.0, description="Pace; 1 is real time.")
    subscribers: int = Field(1, ge=0, le=100, description="Subscribers to events to wait for.")
    pose_subscribers: int = Field(0, ge=0, le=100, description="Subscribers to /tf to wait for.")
    wait_s: float = Field(20.0, ge=0.0, le=600.0, description="Longest wait for them, s.")
    exit_when_done: bool = Field(False, description="Whether to end after the last message.")


class Publisher(Protocol):
    """What is needed of a publisher."""

    topic_name: str

    def get_subscription_count(self) -> int:
        """Subscriptions that it reaches."""


def wait_for_listeners(
    wanted: Sequence[tuple[Publisher, int]], wait_s: float, stop: threading.Event
) -> str:
    """Wait until publishers have their subscribers, and then until no more come.

    Parameters
    ----------
    wanted : sequence of (publisher, int)
        Publishers and how many subscribers each waits for.
    wait_s : float
        How long to wait for them at most, s.
    stop : threading.Event
        Ends the waiting.

    Returns
    -------
    str
        What to report if not all came in time; else empty.
    """
    now = time.monotonic()
    end, changed, before = now + wait_s, now, [-1 for _ in wanted]
    while not stop.is_set():
        counts = [publisher.get_subscription_count() for publisher, _ in wanted]
        now = time.monotonic()
        if counts != before:
            before, changed = counts, now
        complete = all(n >= least for n, (_, least) in zip(counts, wanted, strict=True))
        if complete and now - changed >= SETTLE_S:
            return ""
        if now > end + SETTLE_S:
            found = ", ".join(
                f"{publisher.topic_name} {n} of {least}"
                for n, (publisher, least) in zip(counts, wanted, strict=True)
            )
            late = f"not all subscribers came in {wait_s:g} s ({found}); it begins without them"
            return "" if complete else late
        stop.wait(0.05)
    return ""
