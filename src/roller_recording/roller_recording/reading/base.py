"""What every recording offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.event_stream import StreamCounts
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack


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
    """A piece of a recording.

    Attributes
    ----------
    events : EventArray
        In order of time, in the clock of the poses, ns.
    progress : float
        Share of the recording that has been read, 0–1.
    faults : tuple of RollerError
        What was wrong in this piece; the recording goes on if more steps come.
    """

    events: EventArray
    progress: float
    faults: tuple[RollerError, ...] = field(default=())


class Recording(ABC):
    """Events, poses and the camera's calibration, in the order they were recorded.

    Attributes
    ----------
    camera : Camera
        Calibration of the event camera.
    track : PoseTrack
        Camera optical frame in `base`; grows while `steps` runs.
    counts : StreamCounts
        What was decoded and lost so far.
    duration_s : float
        Length of the recording, seconds; 0 where it isn't known.
    """

    camera: Camera
    track: PoseTrack
    counts: StreamCounts
    duration_s: float = 0.0
    base_frame: str = "base"
    sensor_frame: str = "event_camera_optical_frame"

    @abstractmethod
    def steps(self) -> Iterator[Step]:
        """Read the recording piece by piece.

        Faults that leave the rest readable come inside a step; after one that doesn't, the
        steps end.
        """
