"""Output folders: written aside, put in place when whole; what others made is never touched.

A folder that a command wrote carries a mark, `.roller-output.json`, that lists what was made there,
and by which command. Only what is listed, and is still as it was made, is ever replaced; what
another command made goes only where the run has something of that name. A run writes to
`.roller-partial` inside the folder (which may be a mount point) and moves each entry into place
at its end; a run that is killed leaves the earlier result as it was. A lock keeps a second
writer out.
"""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from .errors import ASIDE, UnwritableOutputError
from .output_mark import (
    MARK,
    entries_made,
    fingerprint,
    is_aside,
    locked,
    makers,
    read_mark,
    write_mark,
)
from .output_overlap import WAY_OUT, refuse_overlap

_LOCK = ".roller-output.lock"
_RESERVE, _REPLACED = ".roller-reserve", ".roller-replaced"
#: Room that is held until the end, for indexes, the report and the mark.
_RESERVE_BYTES = 8_000_000
#: What a disk says that takes no more.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


class OutputFolder:
    """The folder that a command writes; a context manager.

    On leaving it normally, what was written to `partial` is put in place of what an earlier run
    made. After an exception it is thrown away, unless `publish` was called before.

    Parameters
    ----------
    folder : path
        Where results go; made if needed.
    command : str
        The command, for the mark. Those that write the same kind of result have one name.
    inputs : iterable of path
        Files and folders that the command reads; None entries are passed over.
    new : bool
        Whether there may be no earlier result, not even one of ours.
    lasting : iterable of str
        Names of folders that are kept from run to run, such as caches; in `partial` each is a
        link to it. They are written in place: their files are the caller's to replace as a whole.
    always : iterable of str
        Entries that the command always writes. Where another command made one of them, the rest of
        its result would be left beside a part of this one.

    Attributes
    ----------
    path : Path
        The folder, resolved.
    partial : Path
        Where to write; has the folder's name, so that a bag written there is named after it.

    Raises
    ------
    UnwritableOutputError
        On entering: if input and output overlap, if the folder holds what roller didn't make or
        another command's result that this one would replace in part, if another command is
        writing there, or if it can't be written.
    """

    def __init__(
        self,
        folder: Path,
        command: str,
        inputs: Iterable[Path | None] = (),
        new: bool = False,
        lasting: Iterable[str] = (),
        always: Iterable[str] = (),
    ) -> None:
        self._shown = folder
        self._command = command
        self._new = new
        self._inputs = [path for path in inputs if path is not None]
        self._published = self._settled = False
        self._lock: int | None = None
        self._lasting, self._always = list(lasting), list(always)
        self.path = folder.resolve()
        self._aside = self.path / ASIDE
        self.partial = self._aside / (self.path.name or "output")

    def __enter__(self) -> OutputFolder:
        for source in self._inputs:
            refuse_overlap(source, self._shown)
        self._made_here = not self.path.exists()
        try:
            if self.path.exists() and not self.path.is_dir():
                raise UnwritableOutputError(f"{self._shown}: is a file; {WAY_OUT}")
            self.path.mkdir(parents=True, exist_ok=True)
            if not is_aside(self._aside):  # else what is there may be half replaced
                self._check_contents()
            self._lock = locked(self.path / _LOCK)
            if self._lock is None:
                raise UnwritableOutputError(f"{self._shown}: another roller command writes there")
            try:
                self._settle_earlier_run()
                self._check_contents()
                self._begin()
            except BaseException:
                self._leave()
                raise
        except OSError as error:
            raise UnwritableOutputError(
                f"{self._shown}: results can't be written there ({error.strerror}); {WAY_OUT}"
            ) from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self.publish()
            elif isinstance(value, OSError) and value.errno in _FULL:
                raise UnwritableOutputError(
                    f"{self._shown}: results can't be written there ({value.strerror})"
                ) from value
        finally:
            self._leave()

    @property
    def holds_earlier(self) -> bool:
        """Whether the folder holds what an earlier run of this command made."""
        return self._command in makers(self.path).values()

    def publish(self) -> None:
        """Put what was written in place of what an earlier run made; once only.

        Raises
        ------
        UnwritableOutputError
            If something of others came in the way meanwhile; the results are then kept beside
            it, and the message says where. Or if entries can't be moved.
        """
        if self._published:
            return
        self._published = True
        try:
            release_reserve(self.partial)
            for name in self._lasting:
                (self.partial / name).unlink(missing_ok=True)
            made: dict[str, str | None] = {
                path.name: fingerprint(path) for path in sorted(self.partial.iterdir())
            }
            # What another command made stays where this one has nothing of that name.
            before = makers(self.path)
            kept = {
                name: prints
                for name, prints in entries_made(self.path).items()
                if name not in made and (prints is None or before[name] != self._command)
            }
            by = {name: before[name] for name in kept} | dict.fromkeys(made, self._command)
            write_mark(self._aside, self._aside, kept | made, by, whole=True)
            self._move_into_place()
        except OSError as error:
            raise UnwritableOutputError(
                f"{self._shown}: the results can't be put in place ({error.strerror}); "
                f"they are kept in {self.partial}"
            ) from error

    def _check_contents(self) -> None:
        """Refuse a folder with what isn't ours, or with results of ours that were changed."""
        names = set(os.listdir(self.path)) - {_LOCK, ASIDE, "lost+found"}
        if self._new and names:
            raise UnwritableOutputError(f"{self._shown}: is there already; {WAY_OUT}")
        if names and not read_mark(self.path):
            raise UnwritableOutputError(
                f"{self._shown}: holds files that roller did not write ({max(names)}); "
                f"{WAY_OUT}, or empty it"
            )
        by = makers(self.path)
        for name in self._always:
            if name in names and by.get(name, self._command) != self._command:
                whose = f"`roller {by[name]}`" if by[name] else "an older version of roller"
                raise UnwritableOutputError(
                    f"{self._shown}: holds the result of {whose}, of which this one would replace "
                    f"a part; move it away, or {WAY_OUT}"
                )
        for name in by:
            if name in names and not self._is_ours(name):
                raise UnwritableOutputError(
                    f"{self._shown / name}: was changed since roller wrote it; "
                    f"move it away, or {WAY_OUT}"
                )

    def _is_ours(self, name: str) -> bool:
        """Whether an entry is listed and as it was made."""
        made = entries_made(self.path)
        return name in made and made[name] in (None, fingerprint(self.path / name))

    def _settle_earlier_run(self) -> None:
        """Finish what a killed run was about to put in place; throw away what it hadn't done."""
        if not os.path.lexists(self._aside):
            return
        if self._aside.is_symlink() or not self._aside.is_dir() or not is_aside(self._aside):
            raise self._in_the_way(self._aside)
        if read_mark(self._aside).get("whole"):
            self._move_into_place()
        self._remove_aside()

    def _begin(self) -> None:
        self._aside.mkdir()
        write_mark(self._aside, self._aside, {}, {})
        with open(self._aside / _RESERVE, "wb") as file:
            os.posix_fallocate(file.fileno(), 0, _RESERVE_BYTES)
        self.partial.mkdir()
        for name in self._lasting:
            path, made = self.path / name, entries_made(self.path)
            if os.path.lexists(path) and made.get(name, "") is not None:
                raise self._in_the_way(path)
            by = makers(self.path) | {name: self._command}
            write_mark(self.path, self._aside, made | {name: None}, by)
            path.mkdir(exist_ok=True)
            (self.partial / name).symlink_to(path)

    def _move_into_place(self) -> None:
        """Move entries of the partial result; begun again, it goes on where it was."""
        old, new = entries_made(self.path), entries_made(self._aside)
        partial, gone = self.partial, self._aside / _REPLACED
        waiting = [name for name in new if os.path.lexists(partial / name)]
        for name in waiting:
            if os.path.lexists(self.path / name) and not self._is_ours(name):
                kept = self.path / time.strftime("result_%Y-%m-%d_%H-%M-%S")
                os.rename(partial, kept)
                self._settled = True
                raise UnwritableOutputError(
                    f"{self._shown / name}: roller did not write it, so it stays; "
                    f"the results are in {kept}"
                )
        gone.mkdir(exist_ok=True)
        for name, prints in old.items():
            there = prints is not None and os.path.lexists(self.path / name)
            if there and (name in waiting or name not in new) and self._is_ours(name):
                os.rename(self.path / name, gone / name)
        for name in waiting:
            os.rename(partial / name, self.path / name)
        write_mark(self.path, self._aside, new, makers(self._aside))
        self._settled = True

    def _remove_aside(self) -> None:
        """The mark goes last, so that what is left of it is known as ours."""
        for path in self._aside.iterdir() if self._aside.is_dir() else ():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            elif path.name != MARK:
                path.unlink(missing_ok=True)
        (self._aside / MARK).unlink(missing_ok=True)
        with suppress(OSError):
            self._aside.rmdir()

    def _leave(self) -> None:
        """Remove what is not a result; a folder that was made for nothing goes too."""
        if self._lock is None:
            return
        with suppress(OSError):
            # What is whole and couldn't be put in place stays for the next run.
            if is_aside(self._aside) and (self._settled or not self._published):
                self._remove_aside()
            if set(os.listdir(self.path)) == {_LOCK}:
                (self.path / _LOCK).unlink()
                if self._made_here:
                    self.path.rmdir()
        os.close(self._lock)
        self._lock = None

    def _in_the_way(self, path: Path) -> UnwritableOutputError:
        return UnwritableOutputError(
            f"{path}: stands in the way and was not written by roller; {WAY_OUT}"
        )


def release_reserve(partial: Path) -> None:
    """Give back the room that was held for the end of a run, as when the disk is full.

    Parameters
    ----------
    partial : path
        `OutputFolder.partial`; any other folder has no reserve, and nothing happens.
    """
    if is_aside(partial.parent):
        (partial.parent / _RESERVE).unlink(missing_ok=True)
