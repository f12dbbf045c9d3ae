"""The one pipeline from events and poses to depth maps.

The node, the replay command and the tests all drive this object.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from roller_core.camera import Camera
from roller_core.dead_time import DeadTime
from roller_core.errors import RollerError, SettingsError
from roller_core.events import EventArray
from roller_core.hot_pixels import count_events, find_hot_pixels
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64
from roller_emvs.methods.paper import bma as paper

from .depth_map import DepthMap
from .depth_settings import DepthSettings
from .engine import DepthEngine
from .lines.patch_ends import PatchEnds
from .methods import focus
from .rays import F32, MIN_PARALLAX_PX, Packets, make_packets, matrices_at, parallax_px
from .stopwatch import Stopwatch
from .windows import RefusedWindow, Window, WindowCutter

#: What a depth of the paper's methods errs by, pixels of parallax: its median is of a neighbourhood
#: of 45 px, whatever lies there.
_PAPER_ERROR_PX = 1.3
#: Motion of the image, px, during which events share a pose in `focus`.
_PACKET_PX = 0.25


class ParallaxError(RollerError):
    """A window in which depth doesn't follow from the motion."""


@dataclass(frozen=True)
class PreparedWindow:
    """A window's events at their poses, from which a method makes depth."""

    #: Its span and all its events.
    window: Window
    #: Events that count.
    packets: Packets
    #: Reference cameras in base, in the order of `DepthSettings.views`. Shape (views, 4, 4).
    poses: F64
    #: Camera in base in the middle of the window. Shape (4, 4).
    target: F64
    #: That time, ROS time, ns.
    middle_ns: int
    #: Parallax of its motion over the depth range, px.
    parallax_px: float
    #: What was left out.
    notes: tuple[str, ...]


class DepthPipeline(DepthEngine[WindowCutter]):
    """Events and poses in, depth maps out.

    Parameters
    ----------
    settings : DepthSettings
        Method and its parameters.
    camera : Camera
        Calibration of the camera that the events are from.
    track : PoseTrack
        Camera optical frame in base; the caller goes on adding poses to it.

    Raises
    ------
    SettingsError
        For a method that makes no depth maps.
    """

    def __init__(self, settings: DepthSettings, camera: Camera, track: PoseTrack) -> None:
        refuse_surface(settings)
        super().__init__(settings, camera, track, WindowCutter(settings, track))
        if settings.method == "focus":
            self._cutter.dead_time = DeadTime(camera.width, camera.height)
        self.settings = settings
        self._table = camera.undistortion_table()
        self._ray_slope = (self._table[..., 0] - camera.cx) / camera.fx
        self._ends: PatchEnds | None = None
        self._cut = False
        # Whether any window so far was.
        self._textured = False
        if settings.patch_half_length_m:
            edge = settings.patch_half_length_m * 2 / (settings.depth_min_m + settings.depth_max_m)
            self._leave_out_beyond((-edge, edge))
        elif settings.method == "focus":
            ends = float(np.nanmin(self._ray_slope)), float(np.nanmax(self._ray_slope))
            self._ends = PatchEnds(ends, camera.fx)

    @property
    def at_rest(self) -> bool:
        """Whether the last window ended where the sensor came to rest: the scan may be over."""
        return self._cutter.at_rest

    def results(self, flush: bool = False) -> Iterator[DepthMap | RefusedWindow]:
        """Depth maps of all windows that are complete, in order.

        Parameters
        ----------
        flush : bool
            No more events will come: what is left makes up the last window.
        """
        for window in self.windows(flush):
            result = self._reconstruct(window) if isinstance(window, Window) else window
            self._count(None if isinstance(result, RefusedWindow) else result.points)
            yield result

    def windows(self, flush: bool = False) -> Iterator[Window | RefusedWindow]:
        """Windows that are complete, in order, without their depth; see `results`."""
        while (window := self._cutter.cut(flush)) is not None:
            given = window.events
            events = given if isinstance(given, int) else len(given)
            self._counts.events += events - self._cutter.repeated
            yield window
        self._counts.left_out_windows = self._cutter.left_out

    def prepare(self, window: Window, watch: Stopwatch | None = None) -> PreparedWindow:
        """Put a window's events at their poses.

        Raises
        ------
        ParallaxError
            Where the motion gives no depth.
        PoseError
            Where poses are missing.
        """
        s, camera = self.settings, self.camera
        events, watch = window.events, watch or Stopwatch()
        span = window.end_ns - window.start_ns
        middle_ns = window.start_ns + span // 2
        if s.window_rule == "travel":
            # A sensor that stood for part of it saw the surface from the way alone.
            middle_ns = self.track.half_way(window.start_ns, window.end_ns)
        with watch("hot pixels"):
            table, notes = self._usable(events)
        with watch("packets"):
            packets = make_packets(
                events, table, self.track, s.packet_events, self._most_travel_m()
            )
            times = [window.start_ns + round(f * span) for f, _ in s.views()]
            poses = matrices_at(self.track, [*times, middle_ns])
        parallax = parallax_px(packets, camera, poses[-1], s.depth_min_m, s.depth_max_m)
        if parallax < MIN_PARALLAX_PX:
            raise ParallaxError(
                f"parallax of {parallax:.2f} px over depths of {s.depth_min_m:g} to "
                f"{s.depth_max_m:g} m is below {MIN_PARALLAX_PX:g} px: too little motion across "
                "the view for a depth"
            )
        return PreparedWindow(window, packets, poses[:-1], poses[-1], middle_ns, parallax, notes)

    def _most_travel_m(self) -> float:
        """Way in which events share a pose at the most; the paper's packets have no such end."""
        if self.settings.method != "focus":
            return math.inf
        return _PACKET_PX * self.settings.depth_min_m / max(self.camera.fx, self.camera.fy)

    def _reconstruct(self, window: Window) -> DepthMap | RefusedWindow:
        watch, begin, cpu_s = Stopwatch(), time.perf_counter(), time.process_time()
        refused = self._refused(window.start_ns, window.end_ns, len(window.events))
        if refused is not None:
            return refused
        try:
            prepared = self.prepare(window, watch)
            images = self._depth(prepared, watch)
        except RollerError as error:
            return RefusedWindow(window.start_ns, window.end_ns, len(window.events), str(error))
        watch.milliseconds["total"] = (time.perf_counter() - begin) * 1e3
        return DepthMap(
            prepared.middle_ns,
            *images,
            prepared.target,
            window.start_ns,
            window.end_ns,
            len(window.events),
            {k: float(np.round(v, 3)) for k, v in watch.milliseconds.items()},
            prepared.notes,
            round((time.process_time() - cpu_s) * 1e3, 3),
            watch.cpu_ms,
        )

    def _depth(self, prepared: PreparedWindow, watch: Stopwatch) -> tuple[F32, F32, F32]:
        """Depth, confidence and sigma in the middle view."""
        s, camera, packets, target = self.settings, self.camera, prepared.packets, prepared.target
        if s.method == "focus":
            late = self._cutter.dead_time
            blind_m = late.blind_m if late else 0.0
            before = self._ends.ends if self._ends else None
            found = focus.focus_depth(
                packets, camera, target, s, watch, blind_m, self._ends, self._textured
            )
            self._cutter.textured = found.textured
            self._textured |= found.textured
            # From the next window on: this one once more would make the others wait.
            if self._ends and self._ends.ends != before:
                self._leave_out_beyond(self._ends.ends)
            return found.depth, found.confidence, found.sigma
        depth, sure = paper.window_depth(packets, camera, prepared.poses, target, s, watch)
        per_px = (1 / s.depth_min_m - 1 / s.depth_max_m) / prepared.parallax_px
        return depth, sure, depth * depth * np.float32(_PAPER_ERROR_PX * per_px)

    def _leave_out_beyond(self, ends: tuple[float, float]) -> None:
        """Pixels whose rays' slopes aren't between two don't count."""
        self._table, self._cut = self._table.copy(), True
        self._table[(self._ray_slope < ends[0]) | (self._ray_slope > ends[1])] = np.nan

    def _usable(self, events: EventArray) -> tuple[F32, tuple[str, ...]]:
        """Ideal pixels of those that see something where the skin sticks; NaN for all others."""
        counts = np.zeros(self._table.shape[:2], np.float32)
        count_events(events, counts)
        hot, table = find_hot_pixels(counts, columns_too=True), self._table
        notes: tuple[str, ...] = ()
        if hot is not None:
            pixels = np.flatnonzero(hot)
            count = counts.reshape(-1)[pixels].sum()
            notes = (f"{count:.0f} events of {len(pixels)} hot pixels",)
            table = table.copy()
            table.reshape(-1, 2)[pixels] = np.nan
        elsewhere = hot is not None or self._cut
        # As a rule one of the first is.
        if elsewhere and not any(
            np.isfinite(table[events.y[k : k + 1000], events.x[k : k + 1000], 0]).any()
            for k in range(0, len(events), 1000)
        ):
            raise ParallaxError("no event of a good pixel lies in the contact patch")
        return table, notes


def refuse_surface(settings: DepthSettings) -> None:
    """Refuse the method that makes no depth maps.

    Raises
    ------
    SettingsError
        If it is chosen.
    """
    if settings.method == "surface":
        raise SettingsError(
            "'method' = 'surface' makes no depth maps: it has a node of its own, 'surface' "
            "(launch files: method:=surface)"
        )
