"""Ending in order on SIGTERM and SIGHUP as on Ctrl-C, and quietly while a program loads."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import FrameType
from typing import Any

from .library_threads import one_thread_a_library
from .memory import collect_seldom, keep_freed_memory


class Terminated(KeyboardInterrupt):
    """A signal asked for the end; what is under way cleans up as after Ctrl-C.

    Attributes
    ----------
    number : int
        The signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


#: What LLVM's library calls in the middle of compiling; how it takes and leaves its lock, which
#: stays held when an exception comes meanwhile; and when a signal is sent again, s.
_LLVM, _LLVM_CALLS, _LOCKING = "llvmlite.binding", "_raw_object_cache", ("__enter__", "__exit__")
_AGAIN_S = 0.05
#: Signals so soon after one that was answered are of the same impatience, s.
_SAME_S = 1.0


class Interrupter:
    """Handler of signals: raises `KeyboardInterrupt`, of other signals than SIGINT `Terminated`.

    A kernel compiles in C, so the handler mostly runs in what LLVM calls at its end. Raised there
    it would be lost, or take away what was compiled, which reads as a fault: it waits a moment.
    What a destructor raises is lost too. Signals that follow soon change nothing: they would break
    off what cleans up after the first.
    """

    def __init__(self) -> None:
        self._raised_s = -math.inf

    @property
    def raised(self) -> bool:
        """Whether it has raised."""
        return self._raised_s > -math.inf

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Raise, now or in a moment, or never."""
        if time.monotonic() - self._raised_s < _SAME_S:
            return
        while frame is not None:
            if _loses(frame):
                again = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), number))
                again.daemon = True
                again.start()
                return
            frame = frame.f_back
        self._raised_s = time.monotonic()
        raise KeyboardInterrupt if number == signal.SIGINT else Terminated(number)


def _loses(frame: FrameType) -> bool:
    """Whether what is raised in a call is lost, or does harm."""
    name = frame.f_code.co_name
    if name in _LOCKING:
        return str(frame.f_globals.get("__name__")).startswith(_LLVM)
    return name == "__del__" or name.startswith(_LLVM_CALLS)


@contextmanager
def terminate_in_order() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise `Terminated`, where they would end the process at once.

    Whatever started processes of its own can then stop them; SIGINT raises as it does, but once
    of several in a row. Signals that are ignored, as under nohup, stay so; on other threads than
    the main one nothing changes.
    """
    before = _handle_interrupts(Interrupter())
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _handle_interrupts(handler: Interrupter) -> dict[int, Any]:
    """Handle what asks for the end; the handlers that were replaced."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    usual: dict[int, Any] = {signal.SIGINT: signal.default_int_handler}
    wanted = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    found: dict[int, Any] = {s: signal.getsignal(s) for s in wanted}
    before = {s: h for s, h in found.items() if h == usual.get(s, signal.SIG_DFL)}
    for number in before:
        signal.signal(number, handler)
    return before


def run_to_the_end(main: Callable[[], int]) -> int:
    """Run all that a process does, as in `terminate_in_order`; its exit code.

    After an interrupt Python's own end would answer another one with a traceback, and name objects
    that the first left half made: neither is heard.
    """
    handler, say = Interrupter(), sys.unraisablehook
    before = _handle_interrupts(handler)
    sys.unraisablehook = lambda what: None if handler.raised else say(what)
    code = main()
    for number in before:
        late = handler.raised and number == signal.SIGINT
        signal.signal(number, signal.SIG_IGN if late else signal.SIG_DFL)
    return code


@contextmanager
def handling_ends(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Handle the signals that ask for an end for a while: SIGINT, SIGTERM and SIGHUP.

    Under nohup SIGHUP stays ignored; on other threads than the main one nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    wanted = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        wanted.append(signal.SIGHUP)
    before = {number: signal.signal(number, handler) for number in wanted}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


def load_and_run(module: str) -> None:
    """Import a module and call its `main`; libraries that it loads work on one thread.

    What is freed is kept for the next window. An interrupt while the module is imported ends the
    process without a traceback.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # else it is ignored, and stays so
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # `roller up` has it wait
    one_thread_a_library()
    keep_freed_memory()
    collect_seldom()
    main = import_module(module).main
    signal.signal(signal.SIGINT, before)
    main()
