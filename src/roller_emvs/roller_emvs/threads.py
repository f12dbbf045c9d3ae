"""Sharing work between threads that stay alive from window to window."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import count as numbers

#: Threads that may help at once; they are made when they are needed.
_MOST_HELPERS = 256


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_MOST_HELPERS, thread_name_prefix="roller")


def share(threads: int, count: int, run: Callable[[int], object]) -> None:
    """Call `run` with 0 … count - 1 on some threads; each call writes to a place of its own.

    The caller's thread takes part. If it slept, all who help would be woken on its core where the
    others are busy, and run there one after the other. Calls may share their work in turn: what
    nobody comes to help with, the caller does.

    Parameters
    ----------
    threads : int
        Threads at most, the caller's among them.
    count : int
        Number of calls.
    run : callable
        Releases the GIL where it counts.
    """
    left = numbers()

    def work() -> None:
        while (k := next(left)) < count:
            run(k)

    helpers = [_pool().submit(work) for _ in range(min(threads, count) - 1)]
    try:
        work()
    finally:
        # Who has not begun finds nothing left to do.
        helping = [helper for helper in helpers if not helper.cancel()]
        wait(helping)
    for helper in helping:
        helper.result()
