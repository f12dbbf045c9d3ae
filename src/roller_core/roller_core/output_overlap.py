"""Outputs that would be written over what is read."""

from __future__ import annotations

from pathlib import Path

from .errors import UnwritableOutputError

#: What to do about it.
WAY_OUT = "give another --output"


def refuse_overlap(source: Path, output: Path) -> None:
    """Refuse an output that is, holds, or lies in what is read; links are followed.

    A file of a rosbag2 folder stands for all of it.

    Parameters
    ----------
    source : path
        A file or folder that is read.
    output : path
        A file or folder that is to be written; need not exist.

    Raises
    ------
    UnwritableOutputError
        If they overlap.
    """
    if source.is_file() and (source.parent / "metadata.yaml").is_file():
        source = source.parent
    if _lies_in(source, output) or _lies_in(output, source):
        raise UnwritableOutputError(
            f"{output}: overlaps with the input {source}, which would be lost; {WAY_OUT}"
        )


def _lies_in(path: Path, folder: Path) -> bool:
    """Whether a path is a folder or lies in it, also by way of links and mounts."""
    path, folder = path.resolve(), folder.resolve()
    if not folder.exists():
        return path.is_relative_to(folder)
    return any(p.samefile(folder) for p in (path, *path.parents) if p.exists())
