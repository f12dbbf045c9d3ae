"""Messages of a rosbag2, also of one that is damaged.

`rosbags` reads healthy bags. A bag that was cut off while it was written, or whose metadata lack
the storage identifier, is read record by record until it breaks off.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError

from .base import RecordingError, TruncatedRecordingError

_SQLITE = (".db3",)
_MCAP = (".mcap",)


@dataclass(frozen=True)
class RawMessage:
    """A message as it lies in the bag."""

    topic: str
    type: str
    log_ns: int
    data: bytes


class BagReader:
    """Reads a rosbag2 folder, or a single MCAP or SQLite file of one.

    Parameters
    ----------
    path : path
        Folder or file.

    Raises
    ------
    RecordingError
        If there is nothing that could be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._files = _storage_files(path)
        self.healthy = False
        self.topics: dict[str, str] = {}
        self.duration_s = 0.0
        self._start_ns = 0
        if path.is_dir() and (path / "metadata.yaml").is_file():
            self._open_healthy()
        if not self.healthy:
            for message in self._salvage():
                if isinstance(message, RecordingError):
                    break
                self.topics.setdefault(message.topic, message.type)

    def messages(self, topics: set[str]) -> Iterator[RawMessage | RecordingError]:
        """Messages of some topics in the order of logging; a fault, if any, comes last."""
        if not self.healthy:
            for item in self._salvage():
                if isinstance(item, RecordingError) or item.topic in topics:
                    yield item
            return
        with Reader(self.path) as reader:
            wanted = [c for c in reader.connections if c.topic in topics]
            if not wanted:
                return
            source = reader.messages(wanted)
            while True:
                try:
                    item3 = next(source, None)
                except Exception as error:
                    yield self._broken(error)
                    return
                if item3 is None:
                    return
                connection, log_ns, data = item3
                yield RawMessage(connection.topic, connection.msgtype, log_ns, bytes(data))

    def progress(self, log_ns: int) -> float:
        """Share of the recording up to a log time, 0–1."""
        if self.duration_s <= 0:
            return 0.0
        return min(max((log_ns - self._start_ns) * 1e-9 / self.duration_s, 0.0), 1.0)

    def _open_healthy(self) -> None:
        try:
            with Reader(self.path) as reader:
                self.topics = {c.topic: c.msgtype for c in reader.connections}
                self.duration_s = reader.duration * 1e-9
                self._start_ns = reader.start_time
        except (ReaderError, KeyError, OSError, ValueError, TypeError, AssertionError):
            return
        except Exception:
            return
        self.healthy = True

    def _salvage(self) -> Iterator[RawMessage | RecordingError]:
        for file in self._files:
            source = _read_mcap(file) if file.suffix in _MCAP else _read_sqlite(file)
            while True:
                try:
                    message = next(source, None)
                except Exception as error:
                    yield self._broken(error, file)
                    return
                if message is None:
                    break
                yield message

    def _broken(self, error: Exception, file: Path | None = None) -> RecordingError:
        return TruncatedRecordingError(
            f"bag {file or self.path}: breaks off ({type(error).__name__}: "
            f"{str(error).strip() or 'unexpected end'}); what came before is kept"
        )


def _storage_files(path: Path) -> list[Path]:
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    if path.is_file():
        files = [path]
    else:
        files = sorted(p for p in path.iterdir() if p.suffix in _SQLITE + _MCAP)
    if not files or any(p.suffix not in _SQLITE + _MCAP for p in files):
        raise RecordingError(
            f"{path}: holds no rosbag2 storage (.mcap or .db3), is it a bag folder?"
        )
    return files


def _read_mcap(file: Path) -> Iterator[RawMessage]:
    """Record by record; chunks are unpacked as they come, so all whole chunks are recovered."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with open(file, "rb") as stream:
        for record in StreamReader(stream, record_size_limit=None).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels.get(record.channel_id)
                if channel is None or channel.schema_id not in schemas:
                    raise McapError(f"message of unknown channel {record.channel_id}")
                name = schemas[channel.schema_id].name
                yield RawMessage(channel.topic, name, record.log_time, record.data)


def _read_sqlite(file: Path) -> Iterator[RawMessage]:
    database = sqlite3.connect(f"file:{file}?mode=ro", uri=True)
    try:
        topics: dict[int, tuple[str, str]] = {
            row[0]: (row[1], row[2])
            for row in database.execute("SELECT id, name, type FROM topics")
        }
        rows: Any = database.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
        )
        for topic_id, log_ns, data in rows:
            yield RawMessage(*topics[topic_id], log_ns, data)
    finally:
        database.close()
