"""Ending in order on SIGTERM and SIGHUP as on Ctrl-C, and quietly while a program loads."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import FrameType

from .library_threads import one_thread_a_library


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


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, of other signals than SIGINT `Terminated`; handler of a signal.

    A kernel compiles in C, so the handler mostly runs in what LLVM calls at its end. Raised there
    it would be lost, or take away what was compiled, which reads as a fault: it waits a moment.
    What a destructor raises is lost too.
    """
    while frame is not None:
        if _loses(frame):
            again = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), number))
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
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

    Whatever started processes of its own can then stop them; SIGINT raises as it does, but see
    `interrupt`. Signals that are ignored, as under nohup, stay so; on other threads than the main
    one nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    usual = {signal.SIGINT: signal.default_int_handler}
    wanted = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {s: signal.getsignal(s) for s in wanted}
    before = {s: h for s, h in before.items() if h == usual.get(s, signal.SIG_DFL)}
    for number in before:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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

    An interrupt while it is imported ends the process without a traceback.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # else it is ignored, and stays so
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # `roller up` has it wait
    one_thread_a_library()
    main = import_module(module).main
    signal.signal(signal.SIGINT, before)
    main()
