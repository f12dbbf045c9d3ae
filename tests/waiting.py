"""Waiting for what another thread or process does."""

import time
from collections.abc import Callable


def wait_until(
    done: Callable[[], object],
    seen: Callable[[], object] = lambda: "it never came",
    timeout_s: float = 60.0,
) -> None:
    """Fail, with what is seen then, where something doesn't come true in time."""
    end = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < end, seen()
        time.sleep(0.01)
