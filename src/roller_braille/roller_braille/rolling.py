"""When the sensor rolls, found from its poses alone.

A pass is one roll over the surface in one direction; it ends when the sensor stands still, turns
back, leaves its line or when poses are missing. Within a pass, spans are the times it moves on.
Nothing here depends on when poses arrived, so a replay finds the same passes as the live graph.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64, quaternion_to_matrix

from .reader_settings import BrailleSettings

#: A sensor that turns or strays further than this from where a pass began has left its line.
_TURN_RAD = 0.05
_STRAY_M = 0.004
#: Rolling is moving along the camera's x axis at least so many times as much as across it.
_MOSTLY = 2.0
#: Steps shorter than this are joined: over them the noise of poses would look like motion.
_STEP_NS = 5_000_000


@dataclass(frozen=True)
class Pass:
    """One roll over the surface.

    Attributes
    ----------
    rotation, origin : ndarray, shapes (3, 3) and (3,)
        Camera in base where the pass begins; its axes are those of the surface's mosaic.
    direction : int
        +1 or -1: along or against the camera's x axis.
    """

    rotation: F64
    origin: F64
    direction: int


@dataclass
class Span:
    """A time in which the sensor rolls on; `end_ns` grows while it is `open`."""

    roll: Pass
    start_ns: int
    end_ns: int
    open: bool = True
    last_of_pass: bool = False


class RollTracker:
    """Follows the poses and tells spans.

    Parameters
    ----------
    settings : BrailleSettings
        Least speed, standstill, turning back.
    track : PoseTrack
        Camera in base; grows.
    """

    def __init__(self, settings: BrailleSettings, track: PoseTrack) -> None:
        self._settings = settings
        self._track = track
        self._pass: Pass | None = None
        self._span: Span | None = None
        self._furthest = 0.0
        self._moved_ns = 0
        #: Time of the newest pose that was looked at; None before the first two.
        self.known_ns: int | None = None
        self.spans: deque[Span] = deque()
        #: Times between which poses are missing.
        self.gaps: deque[tuple[int, int]] = deque()

    def update(self) -> None:
        """Look at the poses that came since."""
        times = self._track.times_ns
        first = 0 if self.known_ns is None else int(np.searchsorted(times, self.known_ns))
        if len(times) - first < 2:
            return
        rotations = quaternion_to_matrix(self._track.quaternions[first:])
        positions = self._track.positions[first:]
        if self.known_ns is None:
            self.known_ns = int(times[0])
        k, seen = 0, first
        for j in range(1, len(times) - first):
            a, b = int(times[first + k]), int(times[first + j])
            if b - a >= _STEP_NS:
                self._step(a, b, positions[k], positions[j], rotations[k], rotations[j])
                k, seen = j, first + j
        self.known_ns = int(times[seen])

    def stop(self) -> None:
        """End the pass now."""
        self._end_pass()

    def _step(self, a: int, b: int, p0: F64, p1: F64, r0: F64, r1: F64) -> None:
        s = self._settings
        seconds = (b - a) * 1e-9
        if seconds > self._track.max_gap_s:
            self._end_pass()
            self.gaps.append((a, b))
            return
        if self._pass is not None and self._strayed(p1, r1):
            self._end_pass()
        axes = r0 if self._pass is None else self._pass.rotation
        move = (p1 - p0) @ axes
        across = float(np.hypot(move[1], move[2]))
        rolls = abs(move[0]) >= s.min_speed_m_s * seconds and abs(move[0]) >= _MOSTLY * across
        if self._pass is None:
            if not rolls:
                return
            self._pass = Pass(r0.copy(), p0.copy(), 1 if move[0] > 0 else -1)
            self._furthest = 0.0
        travel = float((p1 - self._pass.origin) @ axes[:, 0]) * self._pass.direction
        forward = rolls and move[0] * self._pass.direction > 0 and travel > self._furthest
        if forward:
            self._furthest = travel
            self._moved_ns = b
            if self._span is None:
                self._span = Span(self._pass, a, b)
                self.spans.append(self._span)
            self._span.end_ns = b
            return
        if self._span is not None:
            self._span.open = False
            self._span = None
        back = self._furthest - travel > s.turn_back_m
        if back or b - self._moved_ns >= s.standstill_s * 1e9:
            self._end_pass()

    def _strayed(self, p: F64, r: F64) -> bool:
        assert self._pass is not None
        away = (p - self._pass.origin) @ self._pass.rotation
        cosine = (np.trace(self._pass.rotation.T @ r) - 1) / 2
        return bool(np.hypot(away[1], away[2]) > _STRAY_M or cosine < np.cos(_TURN_RAD))

    def _end_pass(self) -> None:
        if self._pass is None:
            return
        if self._span is not None:
            self._span.open = False
            self._span = None
        # An empty span closes a pass whose last span was taken already.
        end = self._moved_ns
        self.spans.append(Span(self._pass, end, end, open=False, last_of_pass=True))
        self._pass = None
