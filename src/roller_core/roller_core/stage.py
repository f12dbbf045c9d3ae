"""What a node does: an object that takes plain data and gives plain data with a topic.

A live node feeds it with messages and publishes what it gives; a replay feeds it from a recording
and writes the same.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from typing import ClassVar, Generic, TypeVar

from .camera import Camera
from .errors import RollerError
from .frame_settings import FollowedFrames
from .frame_transforms import Transform
from .outputs import Result
from .pose_track import PoseOrderError, PoseTrack
from .sensor_pose import SensorFrames

#: Poses this much older are of a source that started anew, s; so are as many in a row, of any age.
_RESTART_S, _RESTART_POSES = 1.0, 10
#: Poses that are kept where no event waits for them, or half as many: six minutes of an e-series
#: robot, by which depth maps may be late.
_MOST_POSES = 400_000
#: Levels of health, those of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR = 0, 1, 2

S = TypeVar("S", bound=FollowedFrames)


class Stage(ABC, Generic[S]):
    """Follows the sensor's pose and a camera, and gives results.

    Broken input raises and is left out; a source that starts anew is followed.

    Attributes
    ----------
    node, part : str
        Name of its node, and of the node's status.
    model : type
        The node's parameters.
    inputs, outputs : tuple of str
        Topics that it takes and gives.
    most_waiting : int
        Messages that may wait for it, event packets aside.
    memory_ahead : int
        What its first window takes of memory, in 30 MB: taken before the window comes.
    clock_ns : callable
        ROS time now, for latencies.
    camera : Camera or None
        Calibration; None before it came.
    """

    node: ClassVar[str]
    part: ClassVar[str]
    model: ClassVar[type[FollowedFrames]]
    inputs: ClassVar[tuple[str, ...]]
    outputs: ClassVar[tuple[str, ...]]
    most_waiting: ClassVar[int] = 200_000
    memory_ahead: ClassVar[int] = 1

    def __init__(self, settings: S) -> None:
        self.settings = settings
        self.clock_ns: Callable[[], int] = time.time_ns
        self.camera: Camera | None = None
        self.frames = SensorFrames(
            settings.base_frame,
            settings.moving_frame,
            settings.sensor_frame,
            settings.max_pose_gap_s,
            settings.pose_smoothing,
        )
        self._left: list[Result] = []
        # Poses older than the newest, in order of time and one after the other.
        self._older: list[Transform] = []
        # Whether older poses are expected: of a source that is followed anew.
        self._anew = False

    @abstractmethod
    def take_camera(self, camera: Camera) -> None:
        """Take the calibration.

        Raises
        ------
        OtherCameraError
            If the settings are for another camera.
        """

    def take_transform(self, transform: Transform) -> None:
        """Take a transform.

        Raises
        ------
        PoseError, RotationError
            If it can't be used; see `SensorFrames`. The stage begins anew where time ran backwards,
            which is said once.
        """
        try:
            if self.frames.take(transform) and (self._older or self._anew):
                self._older, self._anew = [], False
        except PoseOrderError as error:
            if self._older and transform.t_ns <= self._older[-1].t_ns:
                self._older = []
            told = bool(self._older)
            self._older.append(transform)
            many = len(self._older) >= (1 if self._anew else _RESTART_POSES)
            if many or error.behind_s > _RESTART_S:
                # One alone may be of a clock that was wrong for a moment.
                older = self._older if many else []
                self.restart()
                for each in older:
                    self.frames.take(each)
            if not told:
                raise
        if not self.waits_for_poses:
            self.frames.forget_beyond(_MOST_POSES)

    def take_poses(self, track: PoseTrack) -> None:
        """Take all poses of the camera in base at once, in place of transforms."""
        self.frames.follow(track)

    def restart(self) -> None:
        """Finish what there is and begin anew: the source was started again."""
        self._finish()
        self.frames.restart()
        self._older, self._anew = [], False
        self._begin()

    def clear(self) -> str:
        """Finish what there is and begin a new scan of the same source; says so."""
        self._finish()
        self._begin()
        return "a new scan begins"

    def services(self) -> Mapping[str, Callable[[], str]]:
        """What may be asked of it, by name.

        Each does it and says what was done, or raises `RollerError`; what there is to give then
        comes with the next results.
        """
        return {}

    #: Those of `services` that are about all that came up to now: where other nodes still work on
    #: it, they wait for them.
    patient_services: frozenset[str] = frozenset()

    def results(self, flush: bool = False) -> Iterator[Result]:
        """What is complete by now.

        Parameters
        ----------
        flush : bool
            No more will come for now: all that is left.
        """
        left, self._left = self._left, []
        yield from left
        if flush:
            self.frames.finish()
        yield from self._results(flush)

    @property
    def waits_for_poses(self) -> bool:
        """Whether something waits that may need poses of long ago."""
        return False

    @property
    def settled(self) -> bool:
        """Whether nothing more is to come for what waits, so that it need not wait for long."""
        return False

    @property
    def lost(self) -> bool:
        """Whether data were lost."""
        return False

    @property
    def restarted(self) -> bool:
        """Whether results from before a restart wait to be taken."""
        return bool(self._left)

    def health(self) -> tuple[int, str]:
        """How it is, as a level (`OK`, `WARN`, `ERROR`), and why; empty: all is well."""
        return OK, ""

    @abstractmethod
    def counts(self) -> Mapping[str, object]:
        """What was done and lost so far, as the status says it."""

    @abstractmethod
    def rated(self) -> Mapping[str, float]:
        """Counts whose growth a second the status says, by the names of the rates."""

    def warm_up(self) -> None:
        """Load what takes a second, so that it doesn't come with the first data."""

    def _finish(self) -> None:
        """Keep all that is left for the next call of `results`."""
        kept: list[Result] = []
        try:
            for result in self.results(flush=True):
                kept.append(result)
        except RollerError as error:
            kept.append(Result(None, fault=error))
        self._left += kept

    @abstractmethod
    def _begin(self) -> None:
        """Begin anew with the same camera."""

    @abstractmethod
    def _results(self, flush: bool) -> Iterator[Result]: ...
