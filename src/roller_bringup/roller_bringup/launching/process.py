"""One running process of a plan, and the screen that shows what it says."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
from typing import TextIO

from .document import LaunchError
from .plan import NodeProcess

_LIBC = ctypes.CDLL(None)  # loaded here: between fork and exec little is allowed
_PR_SET_PDEATHSIG = 1

_COLOURS = (36, 32, 33, 35, 34, 96, 92, 93, 95, 94)


class Screen:
    """Writes lines marked with where they come from, one at a time; in colour on a terminal."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream: TextIO | None = sys.stdout if stream is None else stream
        self._lock = threading.Lock()
        self._colours: dict[str, int] = {}
        self._colourful = self._stream.isatty() and "NO_COLOR" not in os.environ

    def line(self, name: str, text: str) -> None:
        """Write one line."""
        with self._lock:
            colour = self._colours.setdefault(name, _COLOURS[len(self._colours) % len(_COLOURS)])
            mark = f"\x1b[{colour}m[{name}]\x1b[0m" if self._colourful else f"[{name}]"
            try:
                if self._stream is not None:
                    self._stream.write(f"{mark} {text}\n")
                    self._stream.flush()
            except (OSError, ValueError):
                # Nobody reads any more (a closed pipe); the nodes go on.
                self._stream = None


class RunningProcess:
    """A process started from a plan, in a process group of its own; what it says is shown.

    It is asked to end (SIGTERM) when the thread that started it is gone, also by SIGKILL.

    Raises
    ------
    LaunchError
        It can't be started.
    """

    def __init__(self, node: NodeProcess, screen: Screen) -> None:
        self.node = node
        starter = os.getpid()

        def end_with_starter() -> None:
            _LIBC.prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0)
            # Ignored, it would be so for good: a shell starts what it leaves behind (&) like that.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            if node.ours:  # while Python starts, it would answer with a traceback
                signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
            if os.getppid() != starter:  # gone already
                os._exit(1)

        try:
            self._process = subprocess.Popen(
                node.command,
                # A node's print would otherwise arrive in blocks, long after it happened.
                env={"PYTHONUNBUFFERED": "1", **node.env},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                # Ctrl-C must reach it through us only: a second SIGINT spoils an orderly end.
                start_new_session=True,
                preexec_fn=end_with_starter,
            )
        except OSError as error:
            raise LaunchError(f"can't start {node.command[0]}: {error.strerror}") from None
        self.pid = self._process.pid
        # Before its own first words are read.
        screen.line("launch", f"{node.label} started (process {self.pid})")
        self._reader = threading.Thread(target=self._read, args=(screen,), daemon=True)
        self._reader.start()

    def _read(self, screen: Screen) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream:
            for line in stream:
                screen.line(self.node.label, line.decode(errors="replace").rstrip("\r\n"))

    def poll(self) -> int | None:
        """Give its exit code (negative: ended by that signal), or None while it runs.

        At its end the rest of its output is read, and what it left running is ended.
        """
        if self._process.returncode is None and self._process.poll() is not None:
            self._reader.join(1.0)
            self.signal(signal.SIGKILL)
            self._reader.join(1.0)
        return self._process.returncode

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to it and everything it started."""
        try:
            os.killpg(self.pid, number)
        except (ProcessLookupError, PermissionError):
            # Gone between our looking and our sending.
            return


def describe(code: int) -> str:
    """Say in words how a process ended."""
    if code < 0:
        known = {number.value: number.name for number in signal.Signals}
        return f"was ended by {known.get(-code, f'signal {-code}')}"
    return "finished" if code == 0 else f"failed with exit code {code}"
