"""The storage files of a rosbag2, whole or damaged, behind one interface.

`rosbags` reads files that are whole. A file that was cut off while it was written is read record
by record (MCAP) or row by row (SQLite) up to where it breaks off.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader

from roller_recording.raw_message import RawMessage

from .base import RecordingError, TruncatedRecordingError

MCAP, SQLITE = ".mcap", ".db3"


class Storage(ABC):
    """A storage file.

    Parameters
    ----------
    path : path
        The file.
    shown : path, optional
        What it is called in messages, where that is another name.

    Attributes
    ----------
    topics : dict
        Type by topic.
    counts : Counter
        Messages by topic.
    start_ns, end_ns : int or None
        Log time of the first and the last message, ns.
    faults : list of RecordingError
        What is wrong with the file.
    """

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        self.path = path
        self.shown = shown or path
        self.topics: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self.faults: list[RecordingError] = []

    @abstractmethod
    def messages(self, topics: set[str]) -> Iterator[RawMessage | RecordingError]:
        """Messages of some topics, and what is wrong where it is met."""

    def _see(self, message: RawMessage) -> None:
        """Take a message into account."""
        self.topics.setdefault(message.topic, message.type)
        self.counts[message.topic] += 1
        log_ns = message.t_ns
        self.start_ns = log_ns if self.start_ns is None else min(self.start_ns, log_ns)
        self.end_ns = log_ns if self.end_ns is None else max(self.end_ns, log_ns)

    def _survey(self, contents: Iterator[RawMessage | RecordingError]) -> None:
        """Take in all that a damaged file holds, and where it breaks off."""
        for item in contents:
            if isinstance(item, RecordingError):
                self.faults.append(item)
            else:
                self._see(item)


class WholeFile(Storage):
    """A file that `rosbags` can read, in the order of log times.

    Raises
    ------
    Exception
        Of any kind, if it can't.
    """

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        super().__init__(path, shown)
        with Reader(path) as reader:
            for c in reader.connections:
                if isinstance(c.ext, ConnectionExtRosbag2) and c.ext.serialization_format != "cdr":
                    self.faults.append(
                        RecordingError(
                            f"bag {self.shown}: {c.topic} is serialized as "
                            f"'{c.ext.serialization_format}'; only cdr can be read"
                        )
                    )
                    continue
                self.topics[c.topic] = c.msgtype
                self.counts[c.topic] += c.msgcount
            if reader.message_count:
                self.start_ns, self.end_ns = reader.start_time, reader.end_time - 1

    def messages(self, topics: set[str]) -> Iterator[RawMessage | RecordingError]:
        """Messages of some topics; a fault, if any, comes last."""
        yield from self.faults
        last_ns = self.start_ns or 0
        try:
            with Reader(self.path) as reader:
                wanted = [
                    c for c in reader.connections if c.topic in topics and c.topic in self.topics
                ]
                if not wanted:
                    return
                for connection, log_ns, data in reader.messages(wanted):
                    yield RawMessage(log_ns, connection.topic, bytes(data), connection.msgtype)
                    last_ns = log_ns
        except Exception as error:  # whatever the library meets in a damaged file
            yield TruncatedRecordingError(
                f"bag {self.shown}: breaks off {(last_ns - (self.start_ns or 0)) * 1e-9:.3f} s "
                f"after its start ({reason(error)}); what came before is kept"
            )


def reason(error: Exception) -> str:
    """An error in a few words."""
    text = str(error).strip()
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
