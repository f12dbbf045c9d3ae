"""What every recording offers."""

from __future__ import annotations

import errno
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.event_stream import StreamCounts
from roller_core.events import EventArray
from roller_core.frame_transforms import Transform
from roller_core.pose_track import PoseError, PoseTrack
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import F64

from .tum import read_tum


class RecordingError(RollerError):
    """A recording that can't be read or lacks what a replay needs."""


class MissingTopicError(RecordingError):
    """A bag without a topic that a replay needs."""


class TruncatedRecordingError(RecordingError):
    """A recording that ends before it should; what came before is good."""


class MalformedRecordingError(RecordingError):
    """A line or message that makes no sense."""


@dataclass(frozen=True)
class Step:
    """A piece of a recording."""

    #: In order of time, in the clock of the poses, ns.
    events: EventArray
    #: Share of the recording that has been read, 0–1.
    progress: float
    #: What was wrong in this piece; the recording goes on if more steps come.
    faults: tuple[RollerError, ...] = ()
    #: What came on /tf or /tf_static.
    transforms: tuple[Transform, ...] = ()
    #: Whether the source of the events started again before these.
    restart: bool = False
    #: Whether packets are numbered anew from these on, while time goes on.
    renumbered: bool = False
    #: A time, ns, and the robot's force then, N.
    force: tuple[int, float] | None = None


class Recording(ABC):
    """Events, poses and the camera's calibration, in the order they were recorded.

    Attributes
    ----------
    source : str
        What was opened, for messages.
    camera : Camera
        Calibration of the event camera.
    poses : PoseTrack or None
        Camera optical frame in base, where that is known beside the events; None where
        transforms come with them.
    counts : StreamCounts
        What was decoded and lost so far.
    duration_s : float
        Length of the recording, seconds; 0 where it isn't known.
    """

    source: str
    camera: Camera
    poses: PoseTrack | None = None
    counts: StreamCounts
    duration_s: float = 0.0
    _pose_faults: tuple[PoseError, ...] = ()
    _frames: SensorFrames | None = None

    @abstractmethod
    def items(self) -> Iterator[Step]:
        """Read the recording piece by piece.

        Faults that leave the rest readable come inside a step; after one that doesn't, the
        steps end.
        """

    def _read_poses(self, path: Path, max_gap_s: float) -> PoseTrack:
        """Poses of a TUM file; what is wrong with them is said with the first step."""
        faults: list[PoseError] = []
        track = read_tum(path, max_gap_s, faults)
        self._pose_faults = tuple(faults)
        return track

    def _first_step(self) -> Iterator[Step]:
        """What is to be said before anything is read."""
        if self._pose_faults:
            yield Step(EventArray.empty(), 0.0, self._pose_faults)

    def follow(self, frames: SensorFrames) -> None:
        """Follow the camera by these frames in `track`, in place of the usual ones."""
        self._frames = frames

    @property
    def track(self) -> PoseTrack:
        """Camera optical frame in `base`; grows while `steps` runs."""
        return self.poses if self.poses is not None else self._following().track

    @property
    def hand_eye(self) -> F64 | None:
        """Camera on the frame that the robot moves, so far, shape (4, 4).

        None where poses are the camera's own, and before the recording has told it.
        """
        frames = self._following()
        if self.poses is not None or frames.moving == frames.sensor:
            return None
        return frames.hand_eye

    def steps(self) -> Iterator[Step]:
        """Read piece by piece, and follow the camera's pose in `track`.

        Where the source of the events started again it ends, as time would run backwards.
        """
        frames = self._following()
        for step in self.items():
            if step.restart:
                yield Step(EventArray.empty(), step.progress, step.faults)
                break
            faults = list(step.faults)
            for transform in step.transforms:
                try:
                    frames.take(transform)
                except RollerError as error:
                    faults.append(error)
            yield replace(step, faults=tuple(faults))
        frames.finish()
        # The last poses let the last events through.
        missing = "" if self.poses is not None else frames.missing()
        last = (MissingTopicError(f"{self.source}: {missing}"),) if missing else ()
        yield Step(EventArray.empty(), 1.0, last)

    def _following(self) -> SensorFrames:
        if self._frames is None:
            self._frames = SensorFrames()
        return self._frames


def check_path(path: Path) -> None:
    """Refuse what can't be read as a recording: opening a pipe would wait for good.

    Raises
    ------
    RecordingError
        If it is neither a file nor a folder, or a folder that can't be read.
    """
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    if not (path.is_file() or path.is_dir()):
        raise RecordingError(f"{path}: neither a file nor a folder, but a pipe or a device")
    if path.is_dir() and not os.access(path, os.R_OK | os.X_OK):
        raise RecordingError(f"{path}: can't be read ({os.strerror(errno.EACCES)})")


def is_dataset(path: Path) -> bool:
    """Whether a path is a folder in the format of the public event-camera dataset."""
    return path.is_dir() and (path / "events.txt").exists()
