"""AEDAT4 files, with poses and calibration from files beside them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

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
    stream : str, optional
        Number of the stream of events, where there are several.

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
        stream: str | None = None,
    ) -> None:
        self._path = path
        self.source = str(path)
        self._stream, width, height = event_stream(path, stream)
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
        self.poses = self._track = PoseTrack.read_tum(poses, max_gap_s)
        self.counts = StreamCounts()
        self.duration_s = (self.poses.end_ns - self.poses.start_ns) * 1e-9

    def items(self) -> Iterator[Step]:
        """Read packet by packet; a file that is cut off ends with a fault."""
        span = max(self._track.end_ns - self._track.start_ns, 1)
        try:
            for events in read_events(self._path, self._stream):
                inside = (events.x < self.camera.width) & (events.y < self.camera.height)
                self.counts.packets += 1
                self.counts.events += int(inside.sum())
                self.counts.outside_events += int(len(events) - inside.sum())
                kept = events[inside].sorted_by_time()
                done = (int(kept.t_ns[-1]) - self._track.start_ns) / span if len(kept) else 0.0
                yield Step(kept, float(np.clip(done, 0, 1)))
        except TruncatedRecordingError as error:
            yield Step(EventArray.empty(), 1.0, (error,))


def event_stream(path: Path, wanted: str | None = None) -> tuple[int, int, int]:
    """Number, width and height, px, of the stream of events of an AEDAT4 file.

    Raises
    ------
    RecordingError
        If there is none, or several and none is wanted.
    """
    found = {
        str(number): (number, int(stream["width"]), int(stream["height"]))
        for number, stream in sorted(_decoder(path).id_to_stream().items())
        if stream["type"] == "events"
    }
    if not found:
        raise RecordingError(f"{path}: the AEDAT4 file holds no event stream")
    if wanted is None and len(found) > 1:
        raise RecordingError(
            f"{path}: the AEDAT4 file holds several event streams; choose with --topic: "
            f"{', '.join(found)}"
        )
    if wanted is not None and wanted not in found:
        raise RecordingError(
            f"{path}: stream {wanted} is none of events; those are {', '.join(found)}"
        )
    return found[wanted] if wanted is not None else next(iter(found.values()))


def read_events(path: Path, stream: int) -> Iterator[EventArray]:
    """Events of a stream of an AEDAT4 file, packet by packet, times as recorded (µs to ns).

    Raises
    ------
    RecordingError
        If the file can't be opened.
    TruncatedRecordingError
        Where the file breaks off.
    """
    packets = iter(_decoder(path))
    count, first_ns, last_ns = 0, 0, 0
    while True:
        try:
            packet = next(packets, None)
        except BaseException as error:
            raise TruncatedRecordingError(
                f"{path}: cut off or broken after {(last_ns - first_ns) * 1e-9:.3f} s "
                f"({_reason(error)}); the {count} events before are read"
            ) from error
        if packet is None:
            return
        if "events" not in packet or packet["stream_id"] != stream:
            continue
        e = packet["events"]
        events = EventArray.from_arrays(
            e["x"], e["y"], e["t"].astype(np.int64) * 1000, e["on"].astype(np.uint8)
        )
        if len(events):
            first_ns = first_ns if count else int(events.t_ns[0])
            last_ns = int(events.t_ns[-1])
        count += len(events)
        yield events


def _decoder(path: Path) -> Any:
    try:
        return aedat.Decoder(str(path))
    except BaseException as error:
        raise RecordingError(f"{path}: not a readable AEDAT4 file ({_reason(error)})") from error


def _reason(error: BaseException) -> str:
    """What the library says; it panics on some broken files, which is no `Exception`."""
    if isinstance(error, KeyboardInterrupt | SystemExit):
        raise error
    return str(error)
