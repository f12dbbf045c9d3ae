"""Files of events alone, with poses and calibration from files beside them."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from roller_core.camera import Camera
from roller_core.codecs import DecodedPacket
from roller_core.event_stream import StreamCounts
from roller_core.events import EventArray
from roller_core.time_order import TimeBackwardsError, TimeOrder
from roller_core.timing_settings import DEFAULT_MAX_POSE_GAP_S

from .base import Recording, RecordingError, Step, TruncatedRecordingError

_READERS = {".aedat4": ".aedat4", ".aedat": ".aedat4", ".raw": ".prophesee"} | dict.fromkeys(
    (".h5", ".hdf5"), ".dsec"
)


#: How names of such files end.
SUFFIXES = tuple(_READERS)


class EventReader(Protocol):
    """A module that reads the events of a kind of file."""

    #: What `roller info` says of how events are encoded.
    ENCODING: str

    def event_stream(self, path: Path, wanted: str | None = None, /) -> tuple[int, int, int]:
        """What `read_events` takes to find the stream, and width and height, px; 0: not known."""

    def read_events(self, path: Path, stream: int, /) -> Iterator[EventArray]:
        """Events, block by block, in the file's clock, ns."""


@runtime_checkable
class BlockReader(EventReader, Protocol):
    """A reader of files of encoded words."""

    def read_blocks(self, path: Path, stream: int, /) -> Iterator[tuple[int, bytes, DecodedPacket]]:
        """Blocks: the byte that they begin at, their words, and what these hold."""


def reader_of(path: Path) -> EventReader | None:
    """The module that reads the events of a file; None if it is no such file."""
    name = _READERS.get(path.suffix.lower()) if path.is_file() else None
    # They bring heavy libraries; only the one that is needed is loaded.
    module: Any = import_module(name, __package__) if name else None
    return module


class EventFileRecording(Recording):
    """Events of a file; poses and camera in the same clock and of the same sensor.

    Parameters
    ----------
    path : path
        An AEDAT4, Prophesee or DSEC file.
    reader : EventReader
        What reads it: see `reader_of`.
    poses : path, optional
        TUM file, camera optical frame in base.
    camera : Camera, optional
        Calibration.
    max_gap_s : float
        See `PoseTrack`.
    stream : str, optional
        Number of the stream of events, where there are several.

    Raises
    ------
    RecordingError
        If the file can't be read, holds no events, or poses or camera are missing.
    """

    def __init__(
        self,
        path: Path,
        reader: EventReader,
        poses: Path | None = None,
        camera: Camera | None = None,
        max_gap_s: float = DEFAULT_MAX_POSE_GAP_S,
        stream: str | None = None,
    ) -> None:
        self._path = path
        self.source = str(path)
        self._reader = reader
        self._stream, width, height = reader.event_stream(path, stream)
        if poses is None:
            raise RecordingError(
                f"{path}: such a file holds no poses; give --poses FILE (TUM: t x y z qx qy qz qw)"
            )
        if camera is None:
            raise RecordingError(
                f"{path}: such a file holds no calibration; give --camera FILE (ROS camera_info)"
            )
        if width and (width, height) != (camera.width, camera.height):
            raise RecordingError(
                f"{path}: events are of {width}×{height} px but the camera file is for "
                f"{camera.width}×{camera.height} px"
            )
        self.camera = camera
        self.poses = self._track = self._read_poses(poses, max_gap_s)
        self.counts = StreamCounts()
        self.duration_s = (self.poses.end_ns - self.poses.start_ns) * 1e-9

    def items(self) -> Iterator[Step]:
        """Read packet by packet; a file that is cut off ends with a fault."""
        yield from self._first_step()
        span, order = max(self._track.end_ns - self._track.start_ns, 1), TimeOrder()
        try:
            for events in self._reader.read_events(self._path, self._stream):
                inside = (events.x < self.camera.width) & (events.y < self.camera.height)
                self.counts.packets += 1
                self.counts.events += int(inside.sum())
                self.counts.outside_events += int(len(events) - inside.sum())
                kept = events[inside].sorted_by_time()
                faults: tuple[TimeBackwardsError, ...] = ()
                try:
                    kept = order.take(kept)
                except TimeBackwardsError as error:
                    kept, faults = error.events, (error,)
                self.counts.late_events = order.late_events
                done = (int(kept.t_ns[-1]) - self._track.start_ns) / span if len(kept) else 0.0
                yield Step(kept, float(np.clip(done, 0, 1)), faults, restart=bool(faults))
        except TruncatedRecordingError as error:
            yield Step(EventArray.empty(), 1.0, (error,))
