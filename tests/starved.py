"""Tests that run in real time are void where the machine stands still meanwhile."""

from __future__ import annotations

import threading
import time
import warnings

import pytest
from _pytest.runner import runtestprotocol

#: On a machine that keeps up, a thread that sleeps is woken no later than this, s.
LIMIT_S = 0.2
#: How often a test is taken at most.
TIMES = 3


class Stalls:
    """The longest time for which a thread that wanted to run could not; a context manager."""

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Stalls:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _watch(self) -> None:
        wait_s, before = 0.02, time.monotonic()
        while not self._end.wait(wait_s):
            now = time.monotonic()
            self.longest_s = max(self.longest_s, now - before - wait_s)
            before = now


def take(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Run a test, and again where it fails while the machine starves: that is told as a warning."""
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for left in reversed(range(TIMES)):
        with Stalls() as stalls:
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
        if not left or stalls.longest_s < LIMIT_S or all(not r.failed for r in reports):
            break
        tell(item, f"taken again: it failed while nothing ran for {stalls.longest_s:.1f} s")
        item._initrequest()  # type: ignore[attr-defined]  # its fixtures anew
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)


def tell(item: pytest.Item, text: str) -> None:
    """Have a warning in the summary."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        warnings.warn(pytest.PytestWarning(text), stacklevel=1)
    item.ihook.pytest_warning_recorded.call_historic(
        kwargs={
            "warning_message": told[0], "when": "runtest", "nodeid": item.nodeid, "location": None
        }
    )  # fmt: skip
