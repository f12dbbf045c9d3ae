"""What makers of depth share, whatever the method: events in, and an account of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from roller_core.camera import Camera
from roller_core.event_queue import EventCutter
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack

from .method_settings import MethodSettings

C = TypeVar("C", bound=EventCutter)


@dataclass(slots=True)
class DepthCounts:
    """What was done so far; a window is a block of rows where there are no depth maps."""

    windows: int = 0
    refused_windows: int = 0
    events: int = 0
    points: int = 0
    dropped_events: int = 0
    events_without_pose: int = 0
    still_events: int = 0
    left_out_windows: int = 0
    broken_passes: int = 0


class DepthEngine(Generic[C]):
    """Base of what makes depth from events and poses.

    Parameters
    ----------
    settings : MethodSettings
        Parameters.
    camera : Camera
        Calibration of the camera that the events are from.
    track : PoseTrack
        Camera optical frame in base; the caller goes on adding poses to it.
    cutter : EventCutter
        Holds events until they can be worked on.
    """

    def __init__(
        self, settings: MethodSettings, camera: Camera, track: PoseTrack, cutter: C
    ) -> None:
        self.camera = camera
        self.track = track
        self._cutter = cutter
        self._counts = DepthCounts()
        self._event_delay_s = settings.event_delay_s

    @property
    def counts(self) -> DepthCounts:
        """What was done and lost so far."""
        self._counts.dropped_events = self._cutter.dropped_events
        self._counts.events_without_pose = self._cutter.events_without_pose
        self._counts.still_events = self._cutter.still_events
        return self._counts

    @property
    def held_events(self) -> int:
        """Events that wait, and rays that wait for their rows to be out of view."""
        return self._cutter.held_events

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed; None while it isn't known."""
        return self._cutter.needed_from_ns

    def add_events(self, events: EventArray) -> None:
        """Take events in order of time, ROS time.

        Raises
        ------
        EventArrayError
            If one lies outside the camera's image.
        """
        events.check_inside(self.camera.width, self.camera.height)
        self._cutter.add(events.compensate_delay(self._event_delay_s))

    def leave_gap(self) -> None:
        """Some events were left out, as there was no keeping up with them."""
        self._cutter.leave_gap()

    def _count(self, points: int | None) -> None:
        """Take a result into account, by its points; None for one that was refused."""
        if points is None:
            self._counts.refused_windows += 1
        else:
            self._counts.windows += 1
            self._counts.points += points
