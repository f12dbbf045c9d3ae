"""How every node of the workspace starts and stops."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import rclpy
from rclpy.executors import ExternalShutdownException

from roller_core.errors import TRACEBACK, RollerError, describe_fault_of_ours
from roller_core.last_resort import ends_within
from roller_core.signals import Interrupter

from .node import LEAVES_WITHIN_S, RollerNode
from .refusals import init_ros, refused_name
from .worker import ENDED

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def run_node(make: Callable[[], RollerNode]) -> int:
    """Spin a node until it is interrupted or its worker gives up.

    Returns
    -------
    int
        Exit code: 0 after an orderly end, 1 when the node could not start or gave up, with one
        line on standard error that says why.
    """
    node: RollerNode | None = None
    failed: BaseException | None = None
    code = 0
    try:
        interrupter = Interrupter()
        for number in _SIGNALS:
            signal.signal(number, interrupter)  # starting may take long
        init_ros()
        node = make()
        with _ended_by_signals():
            rclpy.spin_until_future_complete(node, ENDED)
        if ENDED.done() and (error := ENDED.result()) is not None:
            code = _give_up(error)
    except BaseException as error:
        failed = error  # and with it what its constructor had made
        code = _code_of(error)
    finally:
        # A second signal in the middle of teardown would end it half way: a bag without its end.
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        if node is not None:
            node.exit_code = code
            node.destroy_node()
        with ends_within(LEAVES_WITHIN_S, code):
            rclpy.try_shutdown(uninstall_handlers=False)  # a node that is half made leaves here
            del failed
    return code


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Have signals complete `ENDED`, and interrupt nothing.

    rclpy's own handlers raise in whatever callback is being run, and have another thread shut the
    graph down beside the one that takes the node apart: what was being published then raises too.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)

    def wait() -> None:
        os.read(reader, 1)
        os.close(reader)
        if not ENDED.done():
            ENDED.set_result(None)

    threading.Thread(target=wait, daemon=True).start()
    for number in _SIGNALS:
        signal.signal(number, lambda *_: None)
    # Python writes to it at once, where its own handlers wait for the main thread.
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(-1)
        os.close(writer)


def _code_of(error: BaseException) -> int:
    """Exit code after what ended a node; one line where that is a fault."""
    if isinstance(error, KeyboardInterrupt | ExternalShutdownException):
        return 0
    if isinstance(error, SystemExit):
        return int(error.code or 0)
    if isinstance(error, RollerError):
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 1
    return _give_up(error)


def _give_up(error: BaseException) -> int:
    """Say in one line which fault of ours, or name that ROS refuses, ends the node; exit code."""
    if isinstance(error, Exception) and (refusal := refused_name(error)):
        print(f"error: {refusal}", file=sys.stderr, flush=True)
        return 1
    if os.environ.get(TRACEBACK) == "1":
        traceback.print_exception(error)
    described = describe_fault_of_ours(error, "the node ends")
    print(f"error: {described}", file=sys.stderr, flush=True)
    return 1
