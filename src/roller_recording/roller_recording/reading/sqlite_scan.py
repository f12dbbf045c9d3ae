"""Reading a SQLite bag that was cut off or not closed: every row that can be reached."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from roller_recording.raw_message import RawMessage

from .base import RecordingError, TruncatedRecordingError
from .storage import Storage, reason

_SIDECARS = ("-journal", "-wal")


def has_journal(path: Path) -> bool:
    """Whether a database was not closed: what it holds lies partly in a file beside it."""
    beside = [path.with_name(path.name + suffix) for suffix in _SIDECARS]
    return any(file.is_file() and file.stat().st_size > 0 for file in beside)


class SqliteScan(Storage):
    """A SQLite bag row by row, in the order they were written.

    A database that wasn't closed is brought into order in a copy, not in place.

    Raises
    ------
    RecordingError
        If it is no SQLite bag, or can't be copied.
    """

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        super().__init__(path, shown)
        self._database = path
        self._unclosed = has_journal(path)
        if self._unclosed:
            self._database = self._copy()
        self._survey(self._read(None))

    def messages(self, topics: set[str]) -> Iterator[RawMessage | RecordingError]:
        """Messages of some topics; a fault, if any, comes last."""
        yield from self._read(topics)

    def _read(self, topics: set[str] | None) -> Iterator[RawMessage | RecordingError]:
        count, start_ns, last_ns = 0, None, 0
        fault = "was not closed" if self._unclosed else ""
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
                    if topic_id not in names:
                        continue
                    count, last_ns = count + 1, max(last_ns, log_ns)
                    start_ns = last_ns if start_ns is None else start_ns
                    name, kind = names[topic_id]
                    if topics is None or name in topics:
                        yield RawMessage(log_ns, name, bytes(data), kind)
        except (sqlite3.Error, OverflowError, TypeError) as error:
            fault = f"breaks off ({reason(error)})"
        if fault:
            span_s = (last_ns - (start_ns or 0)) * 1e-9
            yield TruncatedRecordingError(
                f"bag {self.shown}: {fault} after {span_s:.3f} s; "
                f"the {count} messages before are read"
            )

    def _connect(self) -> sqlite3.Connection:
        if self._unclosed:
            return sqlite3.connect(self._database)
        database = sqlite3.connect(f"file:{quote(str(self._database))}?immutable=1", uri=True)
        # Else SQLite refuses a file that is shorter than its header says.
        database.execute("PRAGMA writable_schema=ON")
        return database

    def _copy(self) -> Path:
        self._folder = tempfile.TemporaryDirectory(prefix="roller-")
        copy = Path(self._folder.name) / self.path.name
        try:
            shutil.copyfile(self.path, copy)
            for suffix in _SIDECARS:
                beside = self.path.with_name(self.path.name + suffix)
                if beside.is_file():
                    shutil.copyfile(beside, copy.with_name(copy.name + suffix))
        except OSError as error:
            raise RecordingError(
                f"bag {self.shown}: was not closed, and can't be copied to {copy.parent} to be "
                f"brought into order ({error.strerror}); set TMPDIR to a folder with room"
            ) from error
        return copy
