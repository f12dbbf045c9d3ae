"""AEDAT4 files, with poses and calibration from files beside them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import aedat
import numpy as np

from roller_core.camera import Camera
from roller_core.event_stream import StreamCounts
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack

from .base import Recording, RecordingError, Step, TruncatedRecordingError


class Aedat4Recording(Recording):
    """Events of an AEDAT4 file; poses and camera in the same clock and of the same sensor.

    Parameters
    ----------
    path : path
        The AEDAT4 file.
    poses : path, optional
        TUM file, camera optical frame in base.
    camera : Camera, optional
        Calibration.
    max_gap_s : float
        See `PoseTrack`.

    Raises
    ------
    RecordingError
        If the file isn't AEDAT4, holds no events, or poses or camera are missing.
    """

    def __init__(
        self,
        path: Path,
        poses: Path | None = None,
        camera: Camera | None = None,
        max_gap_s: float = 0.1,
    ) -> None:
        self._path = path
        width, height = stream_size(path)
        if poses is None:
            raise RecordingError(
                f"{path}: an AEDAT4 file holds no poses; "
                "give --poses FILE (TUM: t x y z qx qy qz qw)"
            )
        if camera is None:
            raise RecordingError(
                f"{path}: an AEDAT4 file holds no calibration; give --camera FILE (ROS camera_info)"
            )
        if (width, height) != (camera.width, camera.height):
            raise RecordingError(
                f"{path}: events are of {width}×{height} px but the camera file is for "
                f"{camera.width}×{camera.height} px"
            )
        self.camera = camera
        self.track = PoseTrack.read_tum(poses, max_gap_s)
        self.counts = StreamCounts()
        self.duration_s = (self.track.end_ns - self.track.start_ns) * 1e-9

    def steps(self) -> Iterator[Step]:
        """Read packet by packet; a file that is cut off ends with a fault."""
        span = max(self.track.end_ns - self.track.start_ns, 1)
        try:
            for events in read_events(self._path):
                inside = (events.x < self.camera.width) & (events.y < self.camera.height)
                self.counts.packets += 1
                self.counts.events += int(inside.sum())
                self.counts.outside_events += int(len(events) - inside.sum())
                kept = events[inside].sorted_by_time()
                done = (int(kept.t_ns[-1]) - self.track.start_ns) / span if len(kept) else 0.0
                yield Step(kept, float(np.clip(done, 0, 1)))
        except TruncatedRecordingError as error:
            yield Step(EventArray.empty(), 1.0, (error,))


def stream_size(path: Path) -> tuple[int, int]:
    """Width and height of the event stream of an AEDAT4 file, px.

    Raises
    ------
    RecordingError
        If there is none.
    """
    try:
        streams = aedat.Decoder(str(path)).id_to_stream()
    except (RuntimeError, OSError, ValueError) as error:
        raise RecordingError(f"{path}: not a readable AEDAT4 file ({error})") from error
    for stream in streams.values():
        if stream["type"] == "events":
            return int(stream["width"]), int(stream["height"])
    raise RecordingError(f"{path}: the AEDAT4 file holds no event stream")


def read_events(path: Path) -> Iterator[EventArray]:
    """Events of an AEDAT4 file, packet by packet, times as recorded (µs to ns).

    Raises
    ------
    RecordingError
        If the file can't be opened.
    TruncatedRecordingError
        Where the file breaks off.
    """
    stream_size(path)
    packets = iter(aedat.Decoder(str(path)))
    while True:
        try:
            packet = next(packets, None)
        except (RuntimeError, OSError, ValueError) as error:
            raise TruncatedRecordingError(
                f"{path}: the file breaks off ({error}); what came before is kept"
            ) from error
        if packet is None:
            return
        if "events" in packet:
            e = packet["events"]
            yield EventArray.from_arrays(
                e["x"], e["y"], e["t"].astype(np.int64) * 1000, e["on"].astype(np.uint8)
            )
