"""Waiting until the graph listens, so that nobody misses how a scan begins."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Protocol


class Publisher(Protocol):
    """What is needed of a publisher."""

    topic_name: str

    def get_subscription_count(self) -> int:
        """Subscriptions that it reaches."""


def wait_for_listeners(
    wanted: Sequence[tuple[Publisher, int]], wait_s: float, settle_s: float, stop: threading.Event
) -> str:
    """Wait until publishers have their subscribers, and then until no more come.

    Parameters
    ----------
    wanted : sequence of (publisher, int)
        Publishers and how many subscribers each waits for.
    wait_s : float
        How long to wait for them at most, s.
    settle_s : float
        How long nothing may have changed before it goes on, s: the other side needs a moment to
        know of the publisher, and a node subscribes to its topics one by one.
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
        if complete and now - changed >= settle_s:
            return ""
        if now > end + settle_s:
            found = ", ".join(
                f"{publisher.topic_name} {n} of {least}"
                for n, (publisher, least) in zip(counts, wanted, strict=True)
            )
            late = f"not all subscribers came in {wait_s:g} s ({found}); it begins without them"
            return "" if complete else late
        stop.wait(0.05)
    return ""
