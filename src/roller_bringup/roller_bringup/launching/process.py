"""One running process of a plan: its output, its end."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable

from .errors import LaunchError
from .plan import NodeProcess


class RunningProcess:
    """A process started from a plan, in a process group of its own.

    Parameters
    ----------
    node
        What to start.
    write_line
        Gets its output, line by line, from a thread.

    Raises
    ------
    LaunchError
        It can't be started.
    """

    def __init__(self, node: NodeProcess, write_line: Callable[[str], None]) -> None:
        self.node = node
        # A node's print would otherwise arrive in blocks, long after it happened.
        environment = {"PYTHONUNBUFFERED": "1", **node.env}
        try:
            self._process = subprocess.Popen(
                node.command,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                # Ctrl-C must reach it through us only: a second SIGINT spoils an orderly end.
                start_new_session=True,
            )
        except OSError as error:
            raise LaunchError(f"can't start {node.command[0]}: {error.strerror}") from None
        self._reader = threading.Thread(target=self._read, args=(write_line,), daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its process id, which is also its group's."""
        return self._process.pid

    def _read(self, write_line: Callable[[str], None]) -> None:
        stream = self._process.stdout
        assert stream is not None
        with stream:
            for line in stream:
                write_line(line.decode(errors="replace").rstrip("\r\n"))

    def poll(self) -> int | None:
        """Give its exit code (negative: ended by that signal), or None while it runs."""
        return self._process.poll()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to it and everything it started."""
        try:
            os.killpg(self.pid, number)
        except (ProcessLookupError, PermissionError):
            # Gone between our looking and our sending.
            return

    def wait(self, seconds: float) -> bool:
        """Wait for its end, at most so long; tell whether it came."""
        try:
            self._process.wait(max(seconds, 0.0))
        except subprocess.TimeoutExpired:
            return False
        return True

    def finish(self, grace_s: float = 1.0) -> None:
        """After its end: read the rest of its output and end what it left behind."""
        deadline = time.monotonic() + grace_s
        self._reader.join(max(deadline - time.monotonic(), 0.0))
        self.signal(signal.SIGKILL)
        self._reader.join(grace_s)


def describe(code: int) -> str:
    """Say in words how a process ended."""
    if code < 0:
        try:
            return f"was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"was ended by signal {-code}"
    return "finished" if code == 0 else f"failed with exit code {code}"
