"""The storage files of a rosbag2, whole or damaged, behind one interface.

`rosbags` reads files that are whole. A file that was cut off while it was written is read record
by record (MCAP) or row by row (SQLite) up to where it breaks off.
"""

from __future__ import annotations

import heapq
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, msgsrc

from roller_recording.raw_message import RawMessage

from .base import MalformedRecordingError, RecordingError, TruncatedRecordingError

MCAP, SQLITE, ROS1 = ".mcap", ".db3", ".bag"

Items = Iterator[RawMessage | RecordingError]


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
    unchecked : int
        Pieces without a checksum, in which damage may go unseen.
    unit : str
        What a piece is.
    """

    unchecked = 0
    unit = "messages"

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        self.path = path
        self.shown = shown or path
        self.topics: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self.faults: list[RecordingError] = []

    @abstractmethod
    def messages(self, topics: Collection[str]) -> Items:
        """Messages of some topics, and what is wrong where it is met."""


class BreaksOffError(Exception):
    """A file ends before it should: how, and whether that costs messages."""

    def __init__(self, how: str, in_index: bool = False) -> None:
        super().__init__(how)
        self.in_index = in_index


class ScannedFile(Storage):
    """A file that is read from its beginning, in the order it was written, as far as it goes."""

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        super().__init__(path, shown)
        for item in self._read(None):
            if isinstance(item, RecordingError):
                self.faults.append(item)
                continue
            self.topics.setdefault(item.topic, item.type)
            self.counts[item.topic] += 1
            self.start_ns = min(item.t_ns, self.start_ns or item.t_ns)
            self.end_ns = max(item.t_ns, self.end_ns or item.t_ns)

    def messages(self, topics: Collection[str]) -> Items:
        """Messages of some topics; what is broken is passed over with a fault each."""
        yield from self._read(topics)

    @abstractmethod
    def _contents(self) -> Items:
        """All messages; raises BreaksOffError where the file ends too early."""

    def _read(self, topics: Collection[str] | None) -> Items:
        count, start_ns, last_ns = 0, None, 0
        try:
            for item in self._contents():
                if isinstance(item, RawMessage):
                    count, last_ns = count + 1, max(last_ns, item.t_ns)
                    start_ns = last_ns if start_ns is None else start_ns
                    if topics is not None and item.topic not in topics:
                        continue
                yield item
        except BreaksOffError as end:
            if end.in_index:
                what = f" in the index; all {count} messages are read"
            elif count:
                span_s = (last_ns - (start_ns or 0)) * 1e-9
                what = f" after {span_s:.3f} s; the {count} messages before are read"
            else:
                what = " before the first message; nothing is read"
            yield TruncatedRecordingError(f"bag {self.shown}: {end}{what}")


class WholeFile(Storage):
    """A file that `rosbags` can read, in the order of log times.

    Raises
    ------
    Exception
        Of any kind, if it can't, or reads an MCAP file without chunks no further than its messages
        are in order.
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
            # Reading the index takes long: most of it is quality of service, in YAML.
            self._connections, storage = list(reader.connections), reader.storage
            self._chunks = list(storage.chunks) if isinstance(storage, McapReader) else []
            if isinstance(storage, McapReader) and reader.message_count and not self._chunks:
                raise BreaksOffError("no chunks")

    def messages(self, topics: Collection[str]) -> Items:
        """Messages of some topics; a chunk that is damaged is left out, with a fault."""
        yield from self.faults
        last_ns = self.start_ns or 0
        names = {topic for topic in topics if topic in self.topics}
        wanted = [c for c in self._connections if c.topic in names]
        if not wanted:
            return
        try:
            if self._chunks:
                with self.path.open("rb") as file:
                    yield from self._by_chunks(file, wanted)
                return
            with Reader(self.path) as reader:
                own = [c for c in reader.connections if c.topic in names]
                for connection, log_ns, data in reader.messages(own):
                    yield RawMessage(log_ns, connection.topic, bytes(data), connection.msgtype)
                    last_ns = log_ns
        except Exception as error:  # whatever the library meets in a damaged file
            yield TruncatedRecordingError(
                f"bag {self.shown}: breaks off {(last_ns - (self.start_ns or 0)) * 1e-9:.3f} s "
                f"after its start ({reason(error)}); what came before is kept"
            )

    def _by_chunks(self, file: BinaryIO, wanted: list[Connection]) -> Items:
        """Messages in the order of log times, over chunks that may overlap."""
        channels = {c.id: c for c in wanted}
        chunks = [c for c in self._chunks if any(c.channel_count.get(i) for i in channels)]
        parts = [self._chunk(chunk, channels, file) for chunk in chunks]
        for _, item in heapq.merge(*parts, key=lambda part: part[0]):
            if item is not None:
                yield item

    def _chunk(
        self, chunk: ChunkInfo, channels: dict[int, Connection], file: BinaryIO
    ) -> Iterator[tuple[int, RawMessage | RecordingError | None]]:
        first_ns, last_ns = chunk.message_start_time, chunk.message_end_time
        yield first_ns, None  # it is read when its time has come
        try:
            for found in msgsrc(chunk, channels, first_ns, last_ns + 1, file):
                if found.connection and found.data is not None:
                    kind = found.connection.msgtype
                    message = RawMessage(found.timestamp, found.connection.topic, found.data, kind)
                    yield found.timestamp, message
        except Exception as error:  # the checksum, or whatever damaged bytes lead to
            names = {c.id: c.topic for c in self._connections}
            lost = ", ".join(
                f"{n} of {names.get(i, 'an unknown topic')}"
                for i, n in sorted(chunk.channel_count.items())
            )
            first_s, last_s = ((t - (self.start_ns or 0)) * 1e-9 for t in (first_ns, last_ns))
            yield (
                first_ns,
                MalformedRecordingError(
                    f"bag {self.shown}: the chunk at byte {chunk.chunk_start_offset} is damaged "
                    f"({reason(error)}); its messages from {first_s:.3f} to {last_s:.3f} s are "
                    f"lost: {lost}"
                ),
            )


def reason(error: Exception) -> str:
    """An error in a few words."""
    text = str(error).strip()
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
