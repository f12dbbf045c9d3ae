"""Messages of a rosbag2, also of one that is damaged."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import zstandard

from roller_core.bags import EVENT_PACKET
from roller_recording.raw_message import RawMessage

from .bag_folder import BagFolder
from .base import MalformedRecordingError, RecordingError
from .dvs_messages import DVS_ARRAY, DvsPackets
from .mcap_scan import McapScan
from .sqlite_scan import SqliteScan, has_journal
from .storage import MCAP, ROS1, SQLITE, ScannedFile, Storage, WholeFile, reason

__all__ = ["BagReader", "RawMessage"]

#: Types that are read as another.
_READ_AS = {DVS_ARRAY: EVENT_PACKET}
#: How a compressed message begins; one in CDR never does.
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class BagReader:
    """Reads a rosbag2 folder, a single MCAP or SQLite file of one, or a ROS 1 bag.

    Bags may be split into several files and compressed (zstd) by file, message or chunk.

    Attributes
    ----------
    topics : dict
        Type by topic.
    counts : Counter
        Messages by topic.
    start_ns : int
        Log time of the first message, ns.
    duration_s : float
        From it to that of the last, s.
    custom : dict
        What the recorder noted in the metadata.
    notes : list of str
        What is odd and costs no data.
    faults : list of RecordingError
        What is known to be missing or broken before a message is read.

    Raises
    ------
    RecordingError
        If there is nothing that could be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._folder = BagFolder.open(path)
        self.notes = self._folder.notes
        self.custom = self._folder.custom
        self._lost = list(self._folder.faults)
        self._storages: list[Storage] = []
        for file, shown in self._folder.files:
            try:
                self._storages.append(_open(file, shown))
            except RecordingError as error:
                self._lost.append(error)
        if not self._storages:
            raise self._lost[-1]
        kinds: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        for storage in self._storages:
            kinds = {**storage.topics, **kinds}
            self.counts.update(storage.counts)
        self.topics = {n: _READ_AS.get(kind, kind) for n, kind in kinds.items()}
        starts = [s.start_ns for s in self._storages if s.start_ns is not None]
        ends = [s.end_ns for s in self._storages if s.end_ns is not None]
        self.start_ns = min(starts, default=0)
        self.duration_s = (max(ends, default=0) - self.start_ns) * 1e-9
        self.faults = self._lost + [f for s in self._storages for f in s.faults]
        if self.faults and not self.counts:
            raise self.faults[0]
        announced = self._folder.message_count
        if announced is not None and announced != self.counts.total() and not self.faults:
            self.notes.append(
                f"metadata.yaml speaks of {announced} messages; there are {self.counts.total()}"
            )

    def messages(self, topics: set[str]) -> Iterator[RawMessage | RecordingError]:
        """Messages of some topics, file by file; faults come where they are met."""
        yield from self._lost
        dvs = DvsPackets()
        for storage in self._storages:
            for item in storage.messages(topics):
                if isinstance(item, RawMessage) and item.data[:4] == _ZSTD_MAGIC:
                    item = _unpacked(item, storage.shown)
                if isinstance(item, RawMessage) and item.type == DVS_ARRAY:
                    item = _converted(item, dvs, storage.shown)
                yield item

    def check(self, read: Counter[str]) -> tuple[list[RecordingError], list[str]]:
        """Read the files once more, without their index: what is wrong, and what can't be seen.

        Parameters
        ----------
        read : Counter
            Messages by topic that `messages` gave.
        """
        there: Counter[str] = Counter()
        faults, notes = [], []
        for storage in self._storages:
            scan = storage
            if isinstance(scan, WholeFile):
                scan = _scanned(storage.path, storage.shown)
                faults += scan.faults
            there.update(scan.counts)
            if scan.unchecked:
                notes.append(
                    f"{storage.shown.name}: {scan.unchecked} {scan.unit} have no checksum; "
                    "damage in them can go unseen"
                )
        faults += [
            RecordingError(
                f"bag {self.path}: the index leads to {read[topic]} messages of {topic}; "
                f"there are {there[topic]}"
            )
            for topic in sorted(there)
            if there[topic] != read[topic]
        ]
        return faults, notes

    def progress(self, log_ns: int) -> float:
        """Share of the recording up to a log time, 0–1."""
        if self.duration_s <= 0:
            return 0.0
        return min(max((log_ns - self.start_ns) * 1e-9 / self.duration_s, 0.0), 1.0)


def _open(file: Path, shown: Path) -> Storage:
    """The whole file if it is whole, else what can be read of it."""
    if file.suffix == ROS1:
        from .ros1_file import Ros1File  # what reads ROS 1 takes a moment to load

        return Ros1File(file, shown)
    if file.suffix == SQLITE and has_journal(file):
        return SqliteScan(file, shown)  # the library reads past journals
    try:
        return WholeFile(file, shown)
    except Exception:  # whatever the library meets in a damaged file
        return _scanned(file, shown)


def _scanned(file: Path, shown: Path) -> ScannedFile:
    return McapScan(file, shown) if file.suffix == MCAP else SqliteScan(file, shown)


def _converted(message: RawMessage, dvs: DvsPackets, file: Path) -> RawMessage | RecordingError:
    try:
        data = dvs.from_cdr(message.topic, message.data)
    except Exception as error:  # a damaged message raises whatever its bytes lead to
        return MalformedRecordingError(
            f"bag {file}: a message on {message.topic} at {message.t_ns * 1e-9:.6f} s is "
            f"malformed ({reason(error)}); it is left out"
        )
    return RawMessage(message.t_ns, message.topic, data, EVENT_PACKET)


def _unpacked(message: RawMessage, file: Path) -> RawMessage | RecordingError:
    try:
        data = zstandard.ZstdDecompressor().decompressobj().decompress(message.data)
    except zstandard.ZstdError as error:
        return MalformedRecordingError(
            f"bag {file}: a message on {message.topic} at {message.t_ns * 1e-9:.6f} s can't be "
            f"unpacked ({error}); it is left out"
        )
    return RawMessage(message.t_ns, message.topic, data, message.type)
