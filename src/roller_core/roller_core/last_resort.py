"""Ending a process whatever its threads are stuck in."""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

#: `sigev_notify` that has a thread of the C library call a function (signal.h).
_THREAD = 2


class _Event(ctypes.Structure):
    """What happens when a timer runs out: `struct sigevent`, 64 bytes."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("rest", ctypes.c_char * 40),
    )


@contextmanager
def ends_within(seconds: int, code: int) -> Iterator[None]:
    """End the process, with an exit code, when what is done here takes too long.

    For calls that keep the interpreter's lock for good: nothing in Python runs then, no handler of
    a signal either. A timer calls the C library's `_exit`; where it has no such timers, nothing
    happens. What was printed is written out before.

    Parameters
    ----------
    seconds : int
        Time allowed.
    code : int
        Exit code, 0 to 255.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # gone, or closed
            stream.flush()
    try:
        libc = ctypes.CDLL(None)
        function = ctypes.cast(libc._exit, ctypes.c_void_p)
        event, timer = _Event(code, 0, _THREAD, function, b""), ctypes.c_void_p()
        made = not libc.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer))
    except (AttributeError, OSError):
        made = False
    if not made:
        yield
        return
    # Interval and delay, each in seconds and nanoseconds.
    libc.timer_settime(timer, 0, ctypes.byref((ctypes.c_long * 4)(0, 0, seconds, 0)), None)
    try:
        yield
    finally:
        libc.timer_delete(timer)
