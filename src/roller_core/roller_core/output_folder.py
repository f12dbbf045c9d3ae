"""Output folders."""

from __future__ import annotations

import shutil
from pathlib import Path

from .errors import UnwritableOutputError


def make_folder(folder: Path) -> None:
    """Make an output folder and make sure that files can be written there.

    Raises
    ------
    UnwritableOutputError
        If not.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UnwritableOutputError(
            f"{folder}: results can't be written there ({error.strerror}); give another --output"
        ) from error


def fresh_folder(folder: Path) -> Path:
    """Make a folder to run in, without what an earlier run left there.

    Raises
    ------
    UnwritableOutputError
        If it can't be written.
    """
    make_folder(folder)
    for name in ("bag", "result", "truth"):
        shutil.rmtree(folder / name, ignore_errors=True)
    for name in (
        "surface.ply",
        "braille.txt",
        "braille.json",
        "braille.brf",
        "report.json",
        "overview.png",
    ):
        (folder / name).unlink(missing_ok=True)
    return folder
