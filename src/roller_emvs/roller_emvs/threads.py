"""Sharing work between threads that stay alive from window to window."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache


@lru_cache(maxsize=16)
def _pool(threads: int, inner: bool) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="roller")


def share(threads: int, count: int, run: Callable[[int], object], inner: bool = False) -> None:
    """Call `run` with 0 … count - 1 on some threads; each call writes to a place of its own.

    Parameters
    ----------
    threads : int
        Threads at most; 1 calls one after the other on the caller's.
    count : int
        Number of calls.
    run : callable
        Releases the GIL where it counts.
    inner : bool
        Whether the caller may itself be shared: work that waits for work needs other threads.
    """
    if threads == 1 or count < 2:
        for k in range(count):
            run(k)
        return
    for _ in _pool(threads, inner).map(run, range(count)):
        pass
