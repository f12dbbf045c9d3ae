"""Single files that commands write: replaced only where they are ours."""

from __future__ import annotations

import hashlib
import os
import time
from contextlib import suppress
from pathlib import Path

from .errors import UnwritableOutputError

#: How the last line of a sealed file begins; the digest of what is above it follows.
_SEAL = b"# as written: sha256 "


def write_marked_file(
    path: Path, text: str, mark: str, sealed: bool = False, known: bool = False, stays: str = ""
) -> None:
    """Write a single file, aside first; one that stands there is replaced only if it is ours.

    Parameters
    ----------
    path : path
        The file; its folder is made.
    text : str
        What it is to hold.
    mark : str
        How a file of ours, and the text, begin.
    sealed : bool
        Whether a last line, a comment, tells whether the file was changed since.
    known : bool
        Whether what stands there was read for the text, changed or not.
    stays : str
        Why one of ours is to stay too; empty: it isn't.

    Raises
    ------
    UnwritableOutputError
        If another file stands there, or one of ours that was changed since; the text is then
        written beside it, and the message says where. Or if a folder, pipe or device does, or if
        it can't be written.
    """
    path = path.resolve()
    if sealed:
        text += "" if text.endswith("\n") else "\n"
        text += f"{_SEAL.decode()}{hashlib.sha256(_bytes(text)).hexdigest()}\n"
    part = path.with_name(path.name + time.strftime("_%Y-%m-%d_%H-%M-%S"))
    try:
        if path.exists() and not path.is_file():
            raise UnwritableOutputError(f"{path}: is there and is no file; give another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(_bytes(text))
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


def _begins_with(path: Path, mark: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(mark)) == mark


def _changed(path: Path) -> bool:
    """Whether a sealed file isn't as it was written; of one without a seal that isn't known."""
    text, seal, digest = path.read_bytes().rpartition(_SEAL)
    return bool(seal) and digest.strip() != hashlib.sha256(text).hexdigest().encode()


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", errors="backslashreplace")
