"""Reading a SQLite bag that was cut off or not closed: every row that can be reached."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from roller_recording.raw_message import RawMessage

from .base import RecordingError
from .storage import BreaksOffError, Items, ScannedFile, reason

_SIDECARS = ("-journal", "-wal")


def has_journal(path: Path) -> bool:
    """Whether a database was not closed: what it holds lies partly in a file beside it."""
    beside = [path.with_name(path.name + suffix) for suffix in _SIDECARS]
    return any(file.is_file() and file.stat().st_size > 0 for file in beside)


class SqliteScan(ScannedFile):
    """A SQLite bag row by row, in the order they were written.

    A database that wasn't closed is brought into order in a copy, not in place.

    Raises
    ------
    RecordingError
        If it is no SQLite bag, or can't be copied.
    """

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        self._unclosed = has_journal(path)
        self._database = self._copy(path, shown or path) if self._unclosed else path
        super().__init__(path, shown)
        self.unchecked = self.counts.total()

    def _contents(self) -> Items:
        try:
            with closing(self._connect()) as database:
                names = {
                    row[0]: (row[1], row[2])
                    for row in database.execute("SELECT id, name, type FROM topics")
                }
                # By rows: the index over time is one more thing that can be cut off.
                rows = database.execute(
                    "SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id"
                )
                for topic_id, log_ns, data in rows:
                    if topic_id in names:
                        name, kind = names[topic_id]
                        yield RawMessage(log_ns, name, bytes(data), kind)
        except (sqlite3.Error, OverflowError, TypeError) as error:
            raise BreaksOffError(f"breaks off ({reason(error)})") from error
        if self._unclosed:
            raise BreaksOffError("was not closed")

    def _connect(self) -> sqlite3.Connection:
        if self._unclosed:
            return sqlite3.connect(self._database)
        database = sqlite3.connect(f"file:{quote(str(self._database))}?immutable=1", uri=True)
        # Else SQLite refuses a file that is shorter than its header says.
        database.execute("PRAGMA writable_schema=ON")
        return database

    def _copy(self, path: Path, shown: Path) -> Path:
        self._folder = tempfile.TemporaryDirectory(prefix="roller-")
        copy = Path(self._folder.name) / path.name
        try:
            shutil.copyfile(path, copy)
            for suffix in _SIDECARS:
                beside = path.with_name(path.name + suffix)
                if beside.is_file():
                    shutil.copyfile(beside, copy.with_name(copy.name + suffix))
        except OSError as error:
            raise RecordingError(
                f"bag {shown}: was not closed, and can't be copied to {copy.parent} to be "
                f"brought into order ({error.strerror}); set TMPDIR to a folder with room"
            ) from error
        return copy
