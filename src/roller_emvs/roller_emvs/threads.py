"""Sharing work between threads that stay alive from window to window."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache


@lru_cache(maxsize=8)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="roller")


def share(threads: int, count: int, run: Callable[[int], object]) -> None:
    """Call `run` with 0 … count - 1 on some threads; each call writes to a place of its own.

    Parameters
    ----------
    threads : int
        Threads at most; 1 calls one after the other on the caller's.
    count : int
        Number of calls.
    run : callable
        Releases the GIL where it counts.
    """
    if threads == 1 or count < 2:
        for k in range(count):
            run(k)
        return
    for _ in _pool(threads).map(run, range(count)):
        pass
