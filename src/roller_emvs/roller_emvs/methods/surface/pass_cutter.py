"""Cutting events and poses into passes over the surface, and passes into blocks.

All decisions are taken pose by pose, and a pose is looked at only when the events up to the next
one are complete, so they depend on the data alone and not on when these arrived.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from roller_core.camera import Camera
from roller_core.event_queue import EventCutter
from roller_core.events import EventArray
from roller_core.passes import REST_M, STANDSTILL_S, Heading, Progress, stands
from roller_core.pose_track import PoseError, PoseTrack
from roller_core.transforms import F64, pose_matrix
from roller_emvs.rays import F32
from roller_emvs.windows import RefusedWindow

from .blocks import Block
from .strip import MotionError, Strip
from .surface_settings import SurfaceSettings

#: Travel from which the direction of a pass is taken, m.
_START_M = 0.003
#: Travel for which a pass waits for the dead time of pixels to be known, m: hardly any of it is
#: out of view by then.
_WAIT_M = 0.02
#: Travel back, or away from the surface, that ends a pass, m.
_BACK_M, _AWAY_M = 0.0003, 0.002
#: Travel over which the direction is watched, m, and the cosine of the turn that ends a pass.
_HEADING = 0.002, 0.9

Output = RefusedWindow | tuple[Strip, Block]
#: Events between two poses, the times of these, and the poses.
Step = tuple[EventArray, int, int, F64, F64]


class PassCutter(EventCutter):
    """Holds events until poses cover them, and longer until their rows are out of view.

    Parameters
    ----------
    settings : SurfaceSettings
        Limits.
    camera : Camera
        Calibration.
    track : PoseTrack
        Camera in base; grows meanwhile.
    """

    def __init__(self, settings: SurfaceSettings, camera: Camera, track: PoseTrack) -> None:
        super().__init__(settings.max_waiting_events, track)
        self._settings = settings
        self._camera = camera
        self._rays = _rays_of(camera)
        self._at_ns: int | None = None
        self._strip: Strip | None = None
        self._early: list[Step] = []
        self._waiting: deque[Step] = deque()
        self._anchor: tuple[int, F64] | None = None
        self._newest: tuple[int | None, F64] = None, np.eye(4)
        self._progress, self._heading = Progress(_BACK_M), Heading(*_HEADING)
        # Since when, and where, the sensor has been at rest.
        self._rest: tuple[int, F64] | None = None
        #: Whether the last pass ended where the sensor came to rest.
        self.at_rest = False
        self._dropped = 0
        #: Passes that ended early, where events were left out to keep up.
        self.broken_passes = 0

    @property
    def dropped_events(self) -> int:
        """Events beyond the backlog's limit."""
        return self._queue.dropped + self._dropped

    @property
    def held_events(self) -> int:
        """Events that wait."""
        early = sum(len(e[0]) for e in (*self._early, *self._waiting))
        return len(self._queue) + early + (self._strip.held_events if self._strip else 0)

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed."""
        return self._at_ns

    def cut(self, flush: bool = False) -> Iterator[Output]:
        """Blocks whose rows are out of view, and what had to be refused."""
        while len(self._queue) or self._strip is not None:
            times = self._track.times_ns
            # The newest pose may still be replaced by one of the same time.
            last = len(times) - (1 if flush else 2)
            if last < 1:
                break
            if self._at_ns is None:
                if not len(self._queue):
                    break
                first_ns = self._queue.first_ns
                if first_ns < times[0]:
                    self._drop_unplaced(int(times[0]))
                    continue
                start = int(np.searchsorted(times, first_ns, side="right")) - 1
                if start >= last:
                    break
                self._at_ns = int(times[start])
            k = int(np.searchsorted(times, self._at_ns))
            if k + 1 > last:
                break
            t1 = int(times[k + 1])
            if not flush and self._queue.newest_ns < t1:
                break
            yield from self._step(k)
            self._at_ns = t1
        if flush:
            yield from self._end_pass()
            self._drop_unplaced()
            self._at_ns = None

    def _step(self, k: int) -> Iterator[Output]:
        """What happened between pose `k` of the track and the next."""
        own = slice(k, k + 2)
        t0, t1 = self._track.times_ns[own].tolist()
        events = self._queue.take(self._queue.count_before(t1))
        if self._in_gap(t0, t1):
            # Rows seen by a part of their events would be worse than the rest.
            self.broken_passes += self._strip is not None or bool(self._early)
            yield from self._end_pass()
            return
        try:
            # One after the other, poses miss nothing but what a gap between them is of.
            if t1 - t0 > self._track.max_gap_s * 1e9:
                self._track.check(t0, t1)
        except PoseError as error:
            yield from self._end_pass()
            self.events_without_pose += len(events)
            if len(events):
                yield RefusedWindow(t0, t1, len(events), str(error), error)
            return
        if self.dead_time:
            self.dead_time.measure(events)
        events = self._without_ramps(events, t0, t1)
        pose0, pose1 = self._pose(k, t0), self._pose(k + 1, t1)
        if self._strip is not None:
            local0, local1 = self._strip.to_strip(pose0), self._strip.to_strip(pose1)
            # A scan may end here. Noise goes on, so that no lack of events tells that it did.
            rests = self._rests(t1, pose1[:3, 3])
            if rests or self._leaves(local1):
                yield from self._end_pass()
                self.at_rest = rests
            else:
                self._waiting.append((events, t0, t1, local0, local1))
                yield from self._advance(self._strip)
                return
        yield from self._approach(events, t0, t1, pose0, pose1)

    def _pose(self, k: int, t_ns: int) -> F64:
        """Pose `k` of the track, of that time; the end of a step begins the next."""
        if t_ns != self._newest[0]:
            track = self._track
            self._newest = t_ns, pose_matrix(track.positions[k], track.quaternions[k])
        return self._newest[1]

    def _approach(
        self, events: EventArray, t0: int, t1: int, pose0: F64, pose1: F64
    ) -> Iterator[Output]:
        """Before a pass: wait until the direction of motion is known."""
        if self._anchor is None:
            self._anchor = (t0, pose0)
        since, start = self._anchor
        self._early.append((events, t0, t1, pose0, pose1))
        motion = pose1[:3, 3] - start[:3, 3]
        if np.linalg.norm(motion) >= _START_M:
            try:
                strip = Strip(self._settings, self._camera, self._rays, since, start, motion)
            except MotionError as error:
                self.at_rest = False
                yield from self._give_up(since, t1, str(error))
                return
            early, self._early, self._anchor = self._early, [], None
            self._strip, self._rest, self.at_rest = strip, None, False
            self._progress, self._heading = Progress(_BACK_M), Heading(*_HEADING)
            for part, a, b, first, second in early:
                second = strip.to_strip(second)
                self._leaves(second)
                self._waiting.append((part, a, b, strip.to_strip(first), second))
            yield from self._advance(strip)
        elif t1 - since > self._settings.max_still_s * 1e9:
            yield from self._give_up(
                since,
                t1,
                f"the sensor moved less than {_START_M * 1e3:g} mm in "
                f"{self._settings.max_still_s:g} s: no parallax, no depth",
            )

    def _advance(self, strip: Strip, flush: bool = False) -> Iterator[Output]:
        """Work off what waits, once it is known whether pixels are blind for long."""
        late = self.dead_time
        if not self._waiting:
            return
        known = late is None or late.known or self._waiting[-1][4][0, 3] >= _WAIT_M
        if not (known or flush or self.held_events > self._settings.max_waiting_events):
            return
        while self._waiting:  # each goes as it is voted: none is held twice
            events, t0, t1, pose0, pose1 = self._waiting.popleft()
            self._vote(strip, events, t0, t1, pose0, pose1)
            strip.advance(t1, pose1)
            for block in strip.ready():
                yield strip, block

    def _give_up(self, start_ns: int, end_ns: int, reason: str) -> Iterator[RefusedWindow]:
        count = sum(len(e[0]) for e in self._early)
        self._early, self._anchor = [], None
        if self.at_rest:  # a robot that stands after its scan is no fault
            self.still_events += count
        elif count:
            yield RefusedWindow(start_ns, end_ns, count, reason)

    def _rests(self, t_ns: int, place: F64) -> bool:
        """Whether the sensor has been at rest for long enough to end a pass."""
        if self._rest is None or np.linalg.norm(place - self._rest[1]) >= REST_M:
            self._rest = t_ns, place
        return t_ns - self._rest[0] >= STANDSTILL_S * 1e9

    def _leaves(self, pose: F64) -> bool:
        """Whether the sensor turned back or away from the pass."""
        here = pose[:3, 3]
        self._progress.advance(float(here[0]))
        if self._progress.turned_back(float(here[0])) or abs(here[2]) > _AWAY_M:
            return True
        return self._heading.lost(here)

    def _vote(
        self, strip: Strip, events: EventArray, t0: int, t1: int, pose0: F64, pose1: F64
    ) -> None:
        """Events between two poses into the strip, unless the sensor stood still."""
        if not len(events):
            return
        motion = float(np.linalg.norm(pose1[:3, 3] - pose0[:3, 3]))
        if stands(motion, t1 - t0, self._settings.min_speed_m_s):
            self.still_events += len(events)
            return
        events = self._without_late(events, motion, t1 - t0)
        strip.add(events, t0, t1, pose0, pose1)
        most = self._settings.max_waiting_events
        while strip.held_events > most and len(strip.store.blocks) > 1:
            self._dropped += strip.drop_oldest()

    def _end_pass(self) -> Iterator[Output]:
        """The pass is over: what is left of it is done."""
        strip, self._strip = self._strip, None
        if self._early:
            reason = "the sensor hardly moved before the end: no parallax, no depth"
            yield from self._give_up(self._early[0][1], self._early[-1][2], reason)
        if strip is not None:
            yield from self._advance(strip, flush=True)
            for block in strip.ready(flush=True):
                yield strip, block


@lru_cache(maxsize=4)
def _rays_of(camera: Camera) -> F32:
    """Direction of every pixel, at unit depth; shape (height, width, 2). Shared: read-only."""
    table = camera.undistortion_table().astype(np.float64)
    centre, focal = (camera.cx, camera.cy), (camera.fx, camera.fy)
    rays = np.asarray((table - centre) / focal, np.float32)
    rays.setflags(write=False)
    return rays
