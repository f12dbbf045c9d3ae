"""A rosbag2 (MCAP) written as the messages come."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError

from .bags import typestore
from .errors import UnwritableOutputError
from .mcap_file import WholeMcapWriter

#: A chunk is closed after this, s; a process that is killed loses no more.
CHUNK_S = 0.5


class BagFullError(UnwritableOutputError):
    """The disk takes no more; what was written before is whole.

    `unwritten` holds the messages, by topic, that were taken and are not in the bag.
    """

    def __init__(self, message: str, unwritten: Mapping[str, int] | None = None) -> None:
        super().__init__(message)
        self.unwritten = dict(unwritten or {})


class _Writer(Writer):
    STORAGE_PLUGINS = MappingProxyType({StoragePlugin.MCAP: WholeMcapWriter})


class BagWriter:
    """Writes messages to a new rosbag2, each topic declared with its first message.

    A chunk ends at a megabyte or after `CHUNK_S` and is handed to the operating system whole, so
    that a killed process leaves a bag that is readable up to the last half second.

    Parameters
    ----------
    path : path
        Bag folder to make; may be there if it is empty.
    topics : mapping
        Type, such as ``tf2_msgs/msg/TFMessage``, and offered quality of service by topic.
    compress : bool
        Whether to compress chunks (zstd).
    keep_free_bytes : int
        Disk space that is left for the index and for others.

    Raises
    ------
    UnwritableOutputError
        If the folder holds something or can't be made, or if the disk is full already.
    """

    def __init__(
        self,
        path: Path,
        topics: Mapping[str, tuple[str, list[Qos]]],
        compress: bool = False,
        keep_free_bytes: int = 0,
    ) -> None:
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise UnwritableOutputError(f"{path}: is there already; give another output")
        self.path = path
        self._topics = topics
        self._keep_free = keep_free_bytes
        self._store = typestore()
        self._connections: dict[str, Connection] = {}
        try:
            if path.exists():
                path.rmdir()  # the library makes its own
            self._writer = _Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
            if compress:
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer.open()
        except (OSError, WriterError) as error:
            self._remove_empty()
            why = getattr(error, "strerror", None) or error
            raise UnwritableOutputError(f"{path}: can't be written ({why})") from error
        assert isinstance(self._writer.storage, WholeMcapWriter)
        self._storage = self._writer.storage
        self._file = self._storage.bio
        self._chunk_since = time.monotonic()
        self._file_lock = threading.Lock()
        try:
            self.check_space()
        except BagFullError:
            self._writer.abort()
            self._remove_empty()
            raise

    @property
    def bytes_written(self) -> int:
        """Size of the file, bytes."""
        return int(self._file.tell())

    @property
    def pending(self) -> bool:
        """Whether messages wait for their chunk to be closed."""
        return self._storage.pending

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic."""
        return {topic: self._writer.counts[c.id] for topic, c in list(self._connections.items())}

    @property
    def start_ns(self) -> int | None:
        """Arrival of the first message, ns."""
        return self._writer.min_timestamp if self._connections else None

    def declare_all(self) -> None:
        """Declare all topics now, so that those without a message are in the bag too."""
        for topic in self._topics:
            self._declare(topic)

    def write(self, topic: str, t_ns: int, data: bytes | memoryview) -> None:
        """Write a serialized message with the time at which it came, ns.

        Raises
        ------
        BagFullError
            If the disk takes no more; the messages of the chunk that didn't fit are gone from
            `counts`.
        """
        connection = self._connections.get(topic) or self._declare(topic)
        if not self.pending:
            self._chunk_since = time.monotonic()
        try:
            self._writer.write(connection, t_ns, data)
        except OSError as error:
            # The library counts a message once it is written.
            self._writer.counts[connection.id] += 1
            raise self._full(error) from error

    def tick(self) -> None:
        """Close a chunk that has waited for `CHUNK_S`; call this often.

        Raises
        ------
        BagFullError
            See `write`.
        """
        if time.monotonic() - self._chunk_since >= CHUNK_S:
            self.flush()

    def flush(self) -> None:
        """Close the chunk, however small.

        Raises
        ------
        BagFullError
            See `write`.
        """
        if self.pending:
            try:
                self._storage.close_chunk()
            except OSError as error:
                raise self._full(error) from error

    def check_space(self) -> None:
        """See whether there is room for more.

        Raises
        ------
        BagFullError
            If the disk has less than `keep_free_bytes`.
        """
        if not self._keep_free:
            return
        disk = os.statvfs(self.path)
        free = disk.f_bavail * disk.f_frsize
        if free < self._keep_free:
            raise BagFullError(
                f"{self.path}: the disk is nearly full: {free / 1e6:.0f} MB are free, "
                f"{self._keep_free / 1e6:.0f} MB are kept free (keep_free_mb)"
            )

    def sync(self) -> None:
        """Wait until what was flushed is on the disk; may run in a thread of its own."""
        with self._file_lock:
            if not self._file.closed:
                self._file.sync()

    def close(self, notes: Mapping[str, str] | None = None) -> None:
        """Write index and metadata; `flush` comes first.

        Parameters
        ----------
        notes : mapping, optional
            Goes to the metadata as `custom_data`.

        Raises
        ------
        BagFullError
            If they don't fit; the messages are then still readable.
        """
        for key, value in (notes or {}).items():
            self._writer.set_custom_data(key, value)
        with self._file_lock:
            try:
                self._writer.close()
            except OSError as error:
                self._writer.abort()
                self._writer.metapath.with_suffix(".yaml.tmp").unlink(missing_ok=True)
                raise BagFullError(
                    f"{self.path}: the index can't be written ({error.strerror}); "
                    "`roller replay` and `roller info` read the bag without it"
                ) from error
            finally:
                self._file.discard()

    def _declare(self, topic: str) -> Connection:
        kind, offered = self._topics[topic]
        connection = self._writer.add_connection(
            topic, kind, typestore=self._store, offered_qos_profiles=offered
        )
        self._connections[topic] = connection
        return connection

    def _full(self, error: OSError) -> BagFullError:
        lost, self._storage.unwritten = self._storage.unwritten, {}
        for cid, count in lost.items():
            self._writer.counts[cid] -= count
        return BagFullError(
            f"{self.path}: the bag can't be written ({error.strerror})",
            {topic: lost[c.id] for topic, c in self._connections.items() if c.id in lost},
        )

    def _remove_empty(self) -> None:
        """Leave no folder without a message, which would only block its name."""
        with suppress(OSError):
            (self.path / f"{self.path.name}.mcap").unlink(missing_ok=True)
            self.path.rmdir()
