"""Shared memory that Fast DDS left half made, on which every node that starts waits for good."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

from roller_core.errors import RollerError

#: Where the C library keeps it.
FOLDER = Path("/dev/shm")
#: A participant's port: of Fast DDS 3, and of Fast DDS 2.
_PORT = re.compile(r"fast(dds|rtps)_port\d+")
#: First word, at most, of a segment that nobody has begun to fill (0, or none), or that somebody is
#: filling (Boost's `managed_open_or_create`); and all of one that couldn't be made, as where there
#: is no room: nobody waits for it.
_BEGUN, _FAILED = 1, b"\0"
#: Making one takes milliseconds; what isn't whole after this, s, never will be.
_PATIENCE_S, _LOOK_S = 1.0, 0.05


class SharedMemoryError(RollerError):
    """Shared memory in which no node can start."""


def half_made(folder: Path = FOLDER) -> list[Path]:
    """Ports that a process began to make and hasn't finished.

    One that is killed meanwhile leaves such a port. Whoever opens it waits for the one who makes
    it, with the interpreter's lock held: no signal but SIGKILL ends that.

    Parameters
    ----------
    folder : path
        Where shared memory is.
    """
    found = []
    for path in sorted(folder.glob("fast*_port*")):
        if _PORT.fullmatch(path.name):
            try:
                with path.open("rb") as file:
                    begin = file.read(4)
            except OSError:  # gone by now, or somebody else's
                continue
            if begin != _FAILED and int.from_bytes(begin, sys.byteorder) <= _BEGUN:
                found.append(path)
    return found


def check_shared_memory(folder: Path = FOLDER) -> None:
    """See that no port is half made, before something waits for it.

    Raises
    ------
    SharedMemoryError
        If one is and stays so, naming it.
    """
    end = time.monotonic() + _PATIENCE_S
    while paths := half_made(folder):
        if time.monotonic() > end:
            names = " ".join(map(str, paths))
            raise SharedMemoryError(
                f"no node can start: {names} was left half made by a process that was killed as "
                f"it began; remove it: rm {names}"
            )
        time.sleep(_LOOK_S)
