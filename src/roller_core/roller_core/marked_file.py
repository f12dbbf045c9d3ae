"""Single files that commands write: replaced only where they are ours."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

from .errors import UnwritableOutputError


def write_marked_file(path: Path, text: str, mark: str) -> None:
    """Write a single file, aside first; one that stands there is replaced only if it is ours.

    Parameters
    ----------
    path : path
        The file; its folder is made.
    text : str
        What it is to hold.
    mark : str
        How a file of ours, and the text, begin.

    Raises
    ------
    UnwritableOutputError
        If another file stands there; the text is then written beside it, and the message says
        where. Or if a folder, pipe or device does, or if it can't be written.
    """
    path = path.resolve()
    part = path.with_name(path.name + time.strftime("_%Y-%m-%d_%H-%M-%S"))
    try:
        if path.exists() and not path.is_file():
            raise UnwritableOutputError(f"{path}: is there and is no file; give another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8", errors="backslashreplace")
        if path.exists() and not _begins_with(path, mark.encode()):
            raise UnwritableOutputError(
                f"{path}: roller did not write it, so it stays; the results are in {part}"
            )
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise UnwritableOutputError(f"{path}: can't be written ({error.strerror})") from error


def _begins_with(path: Path, mark: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(mark)) == mark
