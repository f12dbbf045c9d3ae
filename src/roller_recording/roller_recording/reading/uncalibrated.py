"""Recordings of a camera that isn't calibrated yet: events, and transforms where there are any."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from roller_core.camera import Camera
from roller_core.event_stream import StreamCounts
from roller_core.pose_track import PoseTrack

from .bag import BagRecording
from .base import MissingTopicError, Recording, RecordingError, Step, is_dataset
from .event_file import EventReader, reader_of
from .event_topic import event_topic


def open_uncalibrated(path: Path, topic: str | None = None) -> Recording:
    """Open a bag or a file of events for its events.

    Its camera has the image's size; the rest of it is a stand-in that means nothing.

    Parameters
    ----------
    path : path
        Recording.
    topic : str, optional
        Topic of the event packets, or number of the stream, where there are several.

    Raises
    ------
    RecordingError
        If it can't be read, or its image size isn't known.
    """
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    if is_dataset(path):
        raise RecordingError(
            f"{path}: a folder with events.txt doesn't say how large the image is; give a bag or "
            "an .aedat4 or .raw file"
        )
    if (reader := reader_of(path)) is not None:
        return _EventFile(path, reader, topic)
    return _Bag(path, topic=topic)


def _stand_in(width: int, height: int) -> Camera:
    return Camera(width, height, width, width, width / 2, height / 2)


class _Bag(BagRecording):
    def _find(
        self, poses: Path | None, camera: Camera | None, max_gap_s: float, topic: str | None
    ) -> None:
        self._topic = event_topic(self._reader.topics, self._path, topic)
        for item in self._reader.messages({self._topic}):
            if not isinstance(item, RecordingError):
                message: Any = self._store.deserialize_cdr(item.data, item.type)
                self.camera = _stand_in(message.width, message.height)
                return
        raise MissingTopicError(f"bag {self._path}: there is no message on {self._topic}")


class _EventFile(Recording):
    def __init__(self, path: Path, reader: EventReader, stream: str | None) -> None:
        self.source = str(path)
        self._path = path
        self._reader = reader
        self._stream, width, height = reader.event_stream(path, stream)
        if not width:
            raise RecordingError(f"{path}: doesn't say how large its image is")
        self.camera = _stand_in(width, height)
        self.poses = PoseTrack()
        self.counts = StreamCounts()

    def items(self) -> Iterator[Step]:
        for events in self._reader.read_events(self._path, self._stream):
            yield Step(events.sorted_by_time(), 0.0)
