"""The fault of a launch file, or of what it asks for."""

from __future__ import annotations

from pathlib import Path

from roller_core.errors import RollerError


class LaunchError(RollerError):
    """A launch file can't be read or run; the message names file and line where there is one."""

    def __init__(self, message: str, file: Path | None = None, line: int | None = None) -> None:
        self.file = file
        self.line = line
        self.reason = message
        where = "" if file is None else f"{file}:{line}: " if line else f"{file}: "
        super().__init__(where + message)
