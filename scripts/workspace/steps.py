"""Running the steps of the set-up: what is done stays done until what it depends on changes."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path


class SetupError(Exception):
    """The set-up can't go on; the message says what to do."""


def digest(paths: Iterable[Path], *words: str) -> str:
    """Hash files (by name and content; folders with all they hold) and words.

    Build leftovers don't count.

    Parameters
    ----------
    paths
        Files and folders; one that doesn't exist counts as absent.
    *words
        Anything else the result depends on.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    total = hashlib.sha256()
    for word in words:
        total.update(f"word {word}\0".encode())
    for path in paths:
        if path.is_dir():
            found = sorted(
                item
                for item in path.rglob("*")
                if item.is_file()
                and "__pycache__" not in item.parts
                and not any(part.endswith(".egg-info") for part in item.parts)
            )
        else:
            found = [path] if path.exists() else []
        total.update(f"{path.name} {len(found)}\0".encode())
        for item in found:
            content = item.read_bytes()
            total.update(f"{item.relative_to(path.parent)} {len(content)}\0".encode())
            total.update(content)
    return total.hexdigest()


class Steps:
    """The steps done so far, with a stamp for each.

    Parameters
    ----------
    folder
        Where the stamps and the log are kept.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log = folder / "setup.log"

    def is_done(self, name: str, key: str) -> bool:
        """Tell whether a step was finished for this key."""
        stamp = self.folder / name
        return stamp.is_file() and stamp.read_text().strip() == key

    def mark(self, name: str, key: str) -> None:
        """Note a step as finished; written whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        partial = self.folder / f".{name}.{os.getpid()}"
        partial.write_text(key + "\n")
        partial.replace(self.folder / name)

    def forget(self, name: str) -> None:
        """Have a step done again."""
        (self.folder / name).unlink(missing_ok=True)

    def do(self, name: str, what: str, key: str, action: Callable[[], None]) -> bool:
        """Do a step unless it was done for the same key; print one line.

        Returns
        -------
        bool
            Whether it was done now.
        """
        if self.is_done(name, key):
            return False
        print(f"setup: {what} ...", end="", flush=True)
        start = time.monotonic()
        try:
            action()
        except BaseException:
            print(" failed", flush=True)
            raise
        self.mark(name, key)
        print(f" done ({time.monotonic() - start:.0f} s)", flush=True)
        return True

    def run(self, command: list[str], environment: Mapping[str, str] | None = None) -> None:
        """Run a program, its output in the log.

        Raises
        ------
        SetupError
            It failed; the message has the end of its output.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with self.log.open("a") as log:
            log.write(f"\n$ {' '.join(command)}\n")
            log.flush()
            start = log.tell()
            try:
                code = subprocess.run(
                    command,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    stdin=subprocess.DEVNULL,
                    env=None if environment is None else dict(environment),
                    check=False,
                ).returncode
            except OSError as error:
                raise SetupError(f"can't run {command[0]}: {error.strerror}") from None
        if code:
            with self.log.open() as log:
                log.seek(start)
                tail = "".join(f"  {line}" for line in log.readlines()[-15:])
            name = Path(command[0]).name
            raise SetupError(f"{name} failed (exit {code}); all of it in {self.log}:\n{tail}")


def warn(message: str) -> None:
    """Say something the user should know, without stopping."""
    print(f"setup: {message}", file=sys.stderr, flush=True)
