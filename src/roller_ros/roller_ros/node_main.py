"""How every node of the workspace starts and stops."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from roller_core.errors import RollerError
from roller_core.memory import keep_freed_memory
from roller_core.opencv import one_opencv_thread

from .worker import CRASHED


def run_node(make: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Spin a node until it is interrupted.

    Returns
    -------
    int
        Exit code: 0 after an orderly end, 1 when the node could not start or gave up, with one
        line on standard error that says why.
    """
    keep_freed_memory()
    one_opencv_thread()
    rclpy.init(args=list(args) if args is not None else None)
    node: Node | None = None
    code = 0
    try:
        node = make()
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except SystemExit as done:
        code = int(done.code or 0)
    except RollerError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        code = 1
    except Exception:
        # An interrupt shuts the context down at once; what was being published then raises.
        if rclpy.ok():
            raise
    finally:
        # A second SIGINT in the middle of teardown would turn a clean end into a failure.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 1 if CRASHED.is_set() else code
