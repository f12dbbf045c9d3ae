"""Output of several processes on one screen."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

_COLOURS = (36, 32, 33, 35, 34, 96, 92, 93, 95, 94)


class Screen:
    """Writes lines marked with where they come from, one at a time.

    Parameters
    ----------
    stream
        Where to write; None for nowhere.
    folder
        Where to keep what each process said, as <name>.log; None for nowhere.
    """

    def __init__(self, stream: TextIO | None = None, folder: Path | None = None) -> None:
        self._stream = stream
        self._folder = folder
        self._lock = threading.Lock()
        self._colours: dict[str, int] = {}
        self._colourful = stream is not None and stream.isatty() and "NO_COLOR" not in os.environ
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def writer(self, name: str) -> Callable[[str], None]:
        """Give the function that writes a line of one process."""
        with self._lock:
            self._colours.setdefault(name, _COLOURS[len(self._colours) % len(_COLOURS)])
        return lambda line: self.line(name, line)

    def line(self, name: str, text: str) -> None:
        """Write one line."""
        mark = f"[{name}]"
        if self._colourful:
            mark = f"\x1b[{self._colours.get(name, 0)}m{mark}\x1b[0m"
        with self._lock:
            if self._folder is not None:
                with (self._folder / f"{name}.log").open("a") as log:
                    log.write(text + "\n")
            if self._stream is None:
                return
            try:
                self._stream.write(f"{mark} {text}\n")
                self._stream.flush()
            except (OSError, ValueError):
                # Nobody reads any more (a closed pipe); the nodes go on.
                self._stream = None


def standard_screen() -> Screen:
    """Give the screen of a command: standard output."""
    return Screen(sys.stdout)
