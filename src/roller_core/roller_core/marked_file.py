"""Single files that commands write: replaced only where they are ours."""

from __future__ import annotations

import hashlib
import os
import re
import time
from contextlib import suppress
from pathlib import Path

from .errors import UnwritableOutputError

_SEALED = re.compile(rb"(?<=as written: sha256 )[0-9a-f]{64}")
#: Stands in a comment of a text that is to tell whether it was changed since it was written.
SEAL = "as written: sha256 " + 64 * "0"


def write_marked_file(
    path: Path, text: str, mark: str, known: bool = False, stays: str = "", end: str = ""
) -> None:
    """Write a single file, aside first; one that stands there is replaced only if it is ours.

    Parameters
    ----------
    path : path
        The file; its folder is made.
    text : str
        What it is to hold; with `SEAL` in it once, that becomes the text's digest.
    mark : str
        How a file of ours, and the text, begin.
    known : bool
        Whether what stands there was read for the text, changed or not.
    stays : str
        Why one of ours is to stay too; empty: it isn't.
    end : str
        Last line of the text, below which people may write: what stands below that line in the
        file that is replaced is kept, byte for byte. Not for a text with `SEAL` in it. Empty: the
        text is all of the file.

    Raises
    ------
    UnwritableOutputError
        If another file stands there, or one of ours that was changed since; the text is then
        written beside it, and the message says where. Or if a folder, pipe or device does, or if
        it can't be written.
    """
    path = path.resolve()
    data = text.encode("utf-8", errors="backslashreplace")
    data = data.replace(SEAL.encode(), SEAL.encode()[:-64] + _digest(data))
    part = path.with_name(path.name + time.strftime("_%Y-%m-%d_%H-%M-%S"))
    try:
        if path.exists() and not path.is_file():
            raise UnwritableOutputError(f"{path}: is there and is no file; give another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        if end:
            data += _below(path, end)
        part.write_bytes(data)
        if path.exists():
            if not _begins_with(path, mark.encode()):
                stays = "roller did not write it"
            elif not known and _changed(path):
                stays = "was changed since roller wrote it"
            if stays:
                raise UnwritableOutputError(
                    f"{path}: {stays}, so it stays; the results are in {part}"
                )
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise UnwritableOutputError(f"{path}: can't be written ({error.strerror})") from error


def _below(path: Path, line: str) -> bytes:
    """What follows the first such line of a file; nothing where file or line is missing."""
    if not path.exists():
        return b""
    data = path.read_bytes()
    found = re.search(rb"^" + re.escape(line.encode()) + rb"\r?(?:\n|\Z)", data, re.MULTILINE)
    return b"" if found is None else data[found.end() :]


def _begins_with(path: Path, mark: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(mark)) == mark


def _changed(path: Path) -> bool:
    """Whether a sealed file isn't as it was written; of one without a seal that isn't known."""
    data = path.read_bytes()
    seal = _SEALED.search(data)
    return seal is not None and _digest(_SEALED.sub(64 * b"0", data, count=1)) != seal.group()


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).hexdigest().encode()
