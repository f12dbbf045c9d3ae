"""What tells a folder that a command of ours wrote: its mark, and whether it was changed since."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from .errors import ASIDE
from .text_file import TextFileError, read_text

MARK = ".roller-output.json"
_PART = ".roller-mark"
_FORMAT = 1
#: Files up to this size are compared by content, larger ones by size.
_COMPARED_BYTES = 1_000_000


def fingerprint(path: Path) -> str:
    """Tells whether a file, or anything in a folder, was changed, added or removed.

    Names and sizes count, and the content of files up to a megabyte.
    """
    found = hashlib.blake2b(digest_size=16)
    plain = path.is_dir() and not path.is_symlink()
    for file in sorted(path.rglob("*")) if plain else [path]:
        size = -1 if file.is_symlink() or not file.is_file() else file.stat().st_size
        name = "" if file == path else file.relative_to(path)
        found.update(f"{name}\0{file.is_symlink()}\0{size}\0".encode())
        if 0 <= size <= _COMPARED_BYTES:
            found.update(file.read_bytes())
    return found.hexdigest()


def locked(path: Path) -> int | None:
    """Descriptor of a lock file that is ours alone; None if another has it."""
    while True:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        kept = False
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Its holder may have removed it between our opening and locking it.
            kept = path.exists() and os.path.samestat(path.stat(), os.fstat(fd))
            if kept:
                return fd
        except BlockingIOError:
            return None
        finally:
            if not kept:
                os.close(fd)


def is_aside(folder: Path) -> bool:
    """Whether a folder is one of ours to write in, or as a run leaves it that hardly began."""
    try:
        return folder.name == ASIDE and (
            bool(read_mark(folder)) or set(os.listdir(folder)) <= {_PART}
        )
    except OSError:
        return False


def read_mark(folder: Path) -> dict[str, Any]:
    """The mark of a folder; empty if there is none."""
    try:
        data = json.loads(read_text(folder / MARK))
        return data if data["made_by"] == "roller" and isinstance(data["made"], dict) else {}
    except (TextFileError, OSError, ValueError, LookupError, TypeError):
        return {}


def entries_made(folder: Path) -> dict[str, str | None]:
    """Fingerprints by entry of what roller made in a folder; None for what lasts."""
    return dict(read_mark(folder).get("made", {}))


def makers(folder: Path) -> dict[str, str]:
    """The command by entry that made it; empty where an older mark doesn't say."""
    mark = read_mark(folder)
    known = mark.get("makers")
    named = known if isinstance(known, dict) else {}
    return {name: str(named.get(name, "")) for name in mark.get("made", {})}


def write_mark(
    folder: Path,
    aside: Path,
    made: dict[str, str | None],
    by: dict[str, str],
    whole: bool = False,
) -> None:
    """Write a mark, by way of a file in the folder aside.

    Parameters
    ----------
    folder : path
        The folder that is marked.
    aside : path
        One on the same disk, to write in first.
    made, by : dict
        See `entries_made` and `makers`.
    whole : bool
        Whether all of it is written, so that what is aside only has to be put in place.
    """
    data = {"made_by": "roller", "format": _FORMAT, "made": made, "makers": by}
    part = aside / _PART
    part.write_text(json.dumps(data | {"whole": whole}, indent=1) + "\n")
    os.replace(part, folder / MARK)
