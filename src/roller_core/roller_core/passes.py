"""When the sensor rolls, stands, turns back or leaves its path, found from its poses alone.

A pass is one roll over the surface in one direction; it ends when the sensor stands still, turns
back, leaves its line or when poses are missing. Within a pass, spans are the times it moves on.
Nothing here depends on when poses arrived, so a replay finds the same passes as the live graph.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from .pose_track import I64, PoseTrack
from .transforms import F64, quaternion_to_matrix

#: A sensor that turns or strays further than this from where a pass began has left its line.
_TURN_RAD = 0.05
_STRAY_M = 0.004
#: Rolling is moving along the camera's x axis at least so many times as much as across it.
_MOSTLY = 2.0
#: Steps shorter than this are joined: over them the noise of poses would look like motion.
_STEP_NS = 5_000_000
#: A slower sensor stands, m/s; a standstill this long, s, and rolling back this far, m, end a pass.
_MIN_SPEED_M_S, STANDSTILL_S, _TURN_BACK_M = 0.005, 1.0, 0.002
#: A sensor that goes no further than this, m, for so long, s, is at rest: the poses of a robot that
#: holds its place scatter by hundredths of a millimetre, and where it turns back it is gone sooner.
REST_M, REST_S = 1e-4, 0.2
#: So long before a time a sensor is looked at to tell whether it was at rest then, ns; so far along
#: its axis it is off the surface, m.
_AT_REST_NS, _LIFTED_M = 50_000_000, 1e-3


def stands(motion_m: float, duration_ns: int, min_speed_m_s: float) -> bool:
    """Whether a sensor that moved so far in so long is slower than a speed."""
    return motion_m < min_speed_m_s * duration_ns * 1e-9


def rest_begin(times_ns: I64, positions: F64) -> int | None:
    """Where a sensor first came to rest.

    Parameters
    ----------
    times_ns : ndarray of int64, shape (n,)
        Times of poses, growing, ns.
    positions : ndarray of float64, shape (n, 3)
        Places of the sensor, metres.

    Returns
    -------
    int or None
        Number of the pose from which on it stayed within `REST_M` for `REST_S`; None while no poses
        show that. Later poses don't change it.
    """
    last = np.searchsorted(times_ns, times_ns + round(REST_S * 1e9))
    last = last[last < len(times_ns)]
    away = positions[last] - positions[: len(last)]
    for k in np.flatnonzero(np.einsum("ij,ij->i", away, away) < REST_M**2).tolist():
        between = positions[k : last[k] + 1] - positions[k]
        if np.einsum("ij,ij->i", between, between).max() < REST_M**2:
            return k
    return None


class Progress:
    """How far the sensor has come on a pass.

    Parameters
    ----------
    turn_back_m : float
        Rolling back this far ends the pass, metres.
    """

    def __init__(self, turn_back_m: float) -> None:
        self._turn_back = turn_back_m
        #: Furthest travel so far, metres.
        self.furthest_m = 0.0

    def advance(self, travel_m: float) -> bool:
        """Take the travel from where the pass began; whether it is the furthest so far."""
        further = travel_m > self.furthest_m
        self.furthest_m = max(self.furthest_m, travel_m)
        return further

    def turned_back(self, travel_m: float) -> bool:
        """Whether a travel lies too far behind the furthest one."""
        return self.furthest_m - travel_m > self._turn_back


class Heading:
    """Whether the sensor keeps to the direction in which its pass began, its frame's x axis.

    Parameters
    ----------
    step_m : float
        Travel over which the direction is taken, metres: over less, noise would look like a turn.
    cosine : float
        Least cosine of the angle between the direction and the pass's.
    """

    def __init__(self, step_m: float, cosine: float) -> None:
        self._step, self._cosine = step_m, cosine
        self._since = np.zeros(3)

    def lost(self, place: F64) -> bool:
        """Take a place in the frame of the pass, shape (3,), metres; whether the sensor turned."""
        step = place - self._since
        length = float(np.linalg.norm(step))
        if length < self._step:
            return False
        self._since = place.copy()
        return bool(step[0] < self._cosine * length)


@dataclass(frozen=True)
class Pass:
    """One roll over the surface."""

    #: Camera in base where the pass begins; its axes are those of the surface's mosaic. Shapes
    #: (3, 3) and (3,).
    rotation: F64
    origin: F64
    #: +1 or -1: along or against the camera's x axis.
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
    """Finds the spans of passes along the camera's x axis, pose by pose."""

    def __init__(self, track: PoseTrack) -> None:
        self._track = track
        self._pass: Pass | None = None
        self._span: Span | None = None
        self._progress = Progress(_TURN_BACK_M)
        self._moved_ns = 0
        #: Time of the newest pose that was looked at; None before the first two.
        self.known_ns: int | None = None
        self.spans: deque[Span] = deque()
        #: Times between which poses are missing.
        self.gaps: deque[tuple[int, int]] = deque()

    def update(self) -> None:
        """Look at the poses that have come since."""
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
        if (b - a) * 1e-9 > self._track.max_gap_s:
            self._end_pass()
            self.gaps.append((a, b))
            return
        if self._pass is not None and self._strayed(p1, r1):
            self._end_pass()
        axes = r0 if self._pass is None else self._pass.rotation
        move = (p1 - p0) @ axes
        across = float(np.hypot(move[1], move[2]))
        still = stands(abs(move[0]), b - a, _MIN_SPEED_M_S)
        rolls = not still and abs(move[0]) >= _MOSTLY * across
        if self._pass is None:
            if not rolls:
                return
            self._pass = Pass(r0.copy(), p0.copy(), 1 if move[0] > 0 else -1)
            self._progress = Progress(_TURN_BACK_M)
        travel = float((p1 - self._pass.origin) @ axes[:, 0]) * self._pass.direction
        if rolls and move[0] * self._pass.direction > 0 and self._progress.advance(travel):
            self._moved_ns = b
            if self._span is None:
                self._span = Span(self._pass, a, b)
                self.spans.append(self._span)
            self._span.end_ns = b
            return
        if self._span is not None:
            self._span.open = False
            self._span = None
        stood = b - self._moved_ns >= STANDSTILL_S * 1e9
        if stood or self._progress.turned_back(travel):
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


def travel_since(track: PoseTrack, t_ns: int) -> float:
    """How far a rolling sensor went on after a time, metres.

    Nothing where it was at rest then, as at the end of a scan; and no further than to where it is
    lifted off, or pressed on, along its optical axis.
    """
    times, places = track.times_ns, track.positions
    now = int(np.searchsorted(times, t_ns))
    before = int(np.searchsorted(times, t_ns - _AT_REST_NS))
    way = places[now:]
    if not len(way):
        return 0.0
    if now - before > 1 and np.linalg.norm(places[now - 1] - places[before]) < REST_M:
        return 0.0
    axis = quaternion_to_matrix(track.quaternions[now])[:, 2]
    lifted = np.abs((way - way[0]) @ axis) > _LIFTED_M
    if lifted.any():
        way = way[: int(lifted.argmax())]
    return float(np.linalg.norm(way - way[0], axis=1).max())
