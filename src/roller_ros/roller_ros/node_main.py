"""How every node of the workspace starts and stops."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from roller_core.errors import RollerError
from roller_core.memory import keep_freed_memory
from roller_core.opencv import one_opencv_thread

from .worker import CRASHED

#: Set to 1, it has a fault of ours shown where it happened.
TRACEBACK = "ROLLER_TRACEBACK"


def run_node(make: Callable[[], Node]) -> int:
    """Spin a node until it is interrupted or its worker gives up.

    Returns
    -------
    int
        Exit code: 0 after an orderly end, 1 when the node could not start or gave up, with one
        line on standard error that says why.
    """
    node: Node | None = None
    code = 0
    try:
        keep_freed_memory()
        one_opencv_thread()
        rclpy.init()
        node = make()
        rclpy.spin_until_future_complete(node, CRASHED)
        if CRASHED.done():
            code = _give_up(CRASHED.result())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except SystemExit as done:
        code = int(done.code or 0)
    except RollerError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        code = 1
    except Exception as error:
        # An interrupt shuts the context down at once; what was being published then raises.
        if rclpy.ok():
            code = _give_up(error)
    finally:
        # A second signal in the middle of teardown would end it half way: a bag without its end.
        _ignore_signals()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        _ignore_signals()  # rclpy has put back what was there before it
    return code


def _give_up(error: BaseException | None) -> int:
    """Say in one line which fault of ours ends the node; the exit code."""
    if os.environ.get(TRACEBACK) == "1":
        traceback.print_exception(error)
    text = " ".join(str(error).split())
    print(
        f"error: {type(error).__name__}: {text} (a fault of roller, the node ends: please report "
        f"it; {TRACEBACK}=1 shows where)",
        file=sys.stderr,
        flush=True,
    )
    return 1


def _ignore_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
