"""Starts the emulated controller in a process of its own and sends it commands.

The robot's library always uses port 30004, so each process of pytest has a controller at a
loopback address of its own, `own.LOOPBACK`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from own import LOOPBACK

TESTS = Path(__file__).parents[2]


class ControllerProcess:
    """The emulated controller; use as a context manager."""

    def __init__(self, **settings: Any) -> None:
        self._settings = settings
        self._process: subprocess.Popen[str] | None = None
        #: When its clock showed `clock_start_s`, s of CLOCK_MONOTONIC.
        self.begin_s = 0.0

    def __enter__(self) -> ControllerProcess:
        self.start(**self._settings)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, **settings: Any) -> None:
        """Start it, perhaps with other settings than before."""
        paths = [str(TESTS), os.environ.get("PYTHONPATH", "")]
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "driver.emulation.rtde_controller",
                json.dumps({"host": LOOPBACK, **settings}),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        assert line.startswith("ready "), (
            "the emulated controller did not start (is port 30004 in use?)"
        )
        self.begin_s = float(line.split()[1])

    def send(self, line: str) -> None:
        """Give it a command."""
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def stop(self) -> None:
        """End it."""
        if self._process is None:
            return
        self._process.terminate()
        self._process.communicate(timeout=10)
        self._process = None
