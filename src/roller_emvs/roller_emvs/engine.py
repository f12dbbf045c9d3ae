"""What makers of depth share, whatever the method: events in, and an account of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from roller_core.camera import Camera
from roller_core.errors import SettingsError
from roller_core.event_queue import EventCutter
from roller_core.events import EventArray
from roller_core.pose_evenness import StampWatch, UnevenStampsError
from roller_core.pose_track import PoseTrack

from .contact import ContactState, ContactWatch
from .method_settings import MethodSettings
from .windows import RefusedWindow

C = TypeVar("C", bound=EventCutter)

#: A view of the nearest depth is no narrower, m: there no place is seen twice, and what a pixel
#: sees is less than poses scatter by.
_LEAST_VIEW_M = 2e-5


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
    ramp_events: int = 0
    dead_time_events: int = 0
    left_out_windows: int = 0
    broken_passes: int = 0
    bad_contact_windows: int = 0


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

    Raises
    ------
    SettingsError
        If the nearest depth is too near for any view of it.
    """

    def __init__(
        self, settings: MethodSettings, camera: Camera, track: PoseTrack, cutter: C
    ) -> None:
        _check_view(settings.depth_min_m, camera)
        self.camera = camera
        self.track = track
        self._cutter = cutter
        cutter.most_bend_m = settings.depth_min_m / max(camera.fx, camera.fy)
        self._counts = DepthCounts()
        self._event_delay_s = settings.event_delay_s
        self._stamps = StampWatch()
        self._contact = ContactWatch(camera, track, settings.depth_min_m, settings.depth_max_m)

    @property
    def counts(self) -> DepthCounts:
        """What was done and lost so far."""
        self._counts.dropped_events = self._cutter.dropped_events
        self._counts.events_without_pose = self._cutter.events_without_pose
        self._counts.still_events = self._cutter.still_events
        self._counts.ramp_events = self._cutter.ramp_events
        late = self._cutter.dead_time
        self._counts.dead_time_events = late.left_out if late else 0
        return self._counts

    @property
    def held_events(self) -> int:
        """Events that wait, and rays that wait for their rows to be out of view."""
        return self._cutter.held_events

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed; None while it isn't known."""
        needed, watched = self._cutter.needed_from_ns, self._contact.needed_from_ns
        return needed if needed is None or watched is None else min(needed, watched)

    @property
    def contact(self) -> ContactState:
        """What was last seen of the contact between skin and surface."""
        return self._contact.state

    def add_events(self, events: EventArray) -> None:
        """Take events in order of time, ROS time.

        Raises
        ------
        EventArrayError
            If one lies outside the camera's image, or is older than the one before it.
        """
        events.check_inside(self.camera.width, self.camera.height)
        events.check_order()
        events = events.compensate_delay(self._event_delay_s)
        self._contact.add(events)
        self._cutter.add(events)

    def leave_gap(self) -> None:
        """Some events were left out, as there was no keeping up with them."""
        self._cutter.leave_gap()
        self._contact.leave_gap()

    def miss(self) -> None:
        """Some events never came: a window does without them, the contact can't be told."""
        self._contact.leave_gap()

    def _refused(self, start_ns: int, end_ns: int, events: int) -> RefusedWindow | None:
        """A window or block that gives no depth.

        Skin and surface didn't move as one, or the poses don't say how they moved.
        """
        try:
            self._stamps.check(self.track, start_ns, end_ns)
        except UnevenStampsError as error:
            return RefusedWindow(start_ns, end_ns, events, str(error), error)
        fault = self._contact.fault(start_ns, end_ns)
        if not fault:
            return None
        self._counts.bad_contact_windows += 1
        return RefusedWindow(start_ns, end_ns, events, fault, contact=True)

    def _count(self, points: int | None) -> None:
        """Take a result into account, by its points; None for one that was refused."""
        if points is None:
            self._counts.refused_windows += 1
        else:
            self._counts.windows += 1
            self._counts.points += points


def _check_view(near_m: float, camera: Camera) -> None:
    view_m = near_m * max(camera.width / camera.fx, camera.height / camera.fy)
    if view_m < _LEAST_VIEW_M:
        raise SettingsError(
            f"'depth_min_m' = {near_m:g}: the camera's view there is {view_m * 1e6:.2g} µm wide, "
            "which gives no depth; set depth_min_m and depth_max_m around the surface, in metres"
        )


def contact_figures(engine: DepthEngine[Any]) -> dict[str, object]:
    """What a status says of the contact."""
    state = engine.contact
    return {
        "image_speed": "" if state.image_speed is None else round(state.image_speed, 2),
        "contact_mm2": round(state.area_m2 * 1e6),
        "coverage": round(state.fill, 2),
        "bad_contact_windows": engine.counts.bad_contact_windows,
    }
