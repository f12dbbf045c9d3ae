"""The sensor's pose from transforms between named frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .frame_names import BASE_FRAME, CAMERA_FRAME, TOOL_FRAME
from .frame_settings import DEFAULT_SMOOTHING
from .frame_transforms import FixedFrames, Transform
from .passes import REST_M
from .pose_smoothing import StampSmoother
from .pose_track import FASTEST_M_S, PoseJumpError, PoseOrderError, PoseTrack, unit_pose
from .timing_settings import DEFAULT_MAX_POSE_GAP_S
from .transforms import F64, matrix_to_quaternion

#: What places scatter by, m.
_SLACK_M = 1e-3
#: A pose this much later is believed wherever it is, ns.
_BELIEVED_AFTER_NS = 500_000_000
_TOLD_AGAIN_NS = 1_000_000_000
#: Other transforms that are remembered, to say what there is where the robot's pose is not.
_MOST_OTHERS = 8


@dataclass(slots=True)
class PoseCounts:
    """What came of the robot's poses."""

    #: Poses taken.
    poses: int = 0
    #: Times that two of them lay further apart than may be interpolated over.
    gaps: int = 0
    #: Longest time between two of them.
    longest_gap_s: float = 0.0
    #: Poses left out because no arm gets there in the time.
    jumps: int = 0


class SensorFrames:
    """Follows base -> moving frame -> sensor in a stream of transforms.

    The robot moves one frame (`tool0_controller`) in `base`; from there static transforms, in
    either direction, lead to the sensor.

    Parameters
    ----------
    base, moving, sensor : str
        Frame names.
    max_gap_s : float
        See `PoseTrack`.
    smoothing : int
        Later poses that each waits for, so that stamps can be smoothed; it is in the track when
        that many have followed it. See `StampSmoother`.
    """

    def __init__(
        self,
        base: str = BASE_FRAME,
        moving: str = TOOL_FRAME,
        sensor: str = CAMERA_FRAME,
        max_gap_s: float = DEFAULT_MAX_POSE_GAP_S,
        smoothing: int = DEFAULT_SMOOTHING,
    ) -> None:
        self.base = base
        self.moving = moving
        self.sensor = sensor
        self.track = PoseTrack(max_gap_s)
        self.counts = PoseCounts()
        self._newest: tuple[int, F64] | None = None
        self._rest: tuple[int, F64] | None = None
        self._jump_told_ns = -(2**62)
        self._fixed = FixedFrames()
        self._hand_eye: F64 | None = np.eye(4) if moving == sensor else None
        self._turn = np.array([0.0, 0.0, 0.0, 1.0])  # its rotation
        self._waiting: list[tuple[int, tuple[F64, F64]]] = []
        self._smoother: StampSmoother[tuple[F64, F64]] = StampSmoother(smoothing)
        self._others: dict[tuple[str, str], None] = {}
        self._given: PoseTrack | None = None
        self._span_ns: tuple[int, int] | None = None

    @property
    def hand_eye(self) -> F64 | None:
        """Transform moving frame -> sensor, shape (4, 4); None while not known."""
        return self._hand_eye

    @property
    def has_robot_poses(self) -> bool:
        """Whether any pose of the moving frame came."""
        return self._given is not None or self.counts.poses > 0

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Times between which there were poses; None while there was none."""
        return self._span_ns

    @property
    def rest_ns(self) -> tuple[int, int] | None:
        """Since when, and until which pose, the moving frame stays where it is; None before one."""
        if self._rest is None or self._newest is None:
            return None
        return self._rest[0], self._newest[0]

    def missing(self) -> str:
        """What is missing for a pose of the sensor; empty: nothing."""
        if not self.has_robot_poses:
            there = ", ".join(f"{parent} -> {child}" for parent, child in self._others)
            hint = f"; there is {there}: set base_frame and moving_frame" if there else ""
            return f"no poses {self.base} -> {self.moving} on /tf{hint}"
        if self._hand_eye is None and self._given is None:
            return f"no path {self.moving} -> {self.sensor} on /tf_static"
        return ""

    def follow(self, track: PoseTrack) -> None:
        """Take all poses of the sensor in base at once, in place of transforms.

        Their stamps are smoothed as those of transforms are.
        """
        smoother: StampSmoother[tuple[F64, F64]] = StampSmoother(self._smoother.neighbours)
        given = PoseTrack(track.max_gap_s)
        poses = zip(track.positions, track.quaternions, strict=True)
        smoothed = [out for t_ns, pose in zip(track.times_ns.tolist(), poses, strict=True)
                    for out in smoother.push(t_ns, pose)]  # fmt: skip
        for t_ns, (p, q) in smoothed + smoother.finish():
            given.append(t_ns, p, q)
        self.track.assign(given)
        self._given = given
        if len(track):
            self._span_ns = track.start_ns, track.end_ns

    def take(self, transform: Transform) -> bool:
        """Take a transform; see `add_static` and `add`."""
        t = transform
        if t.static:
            self.add_static(t.parent, t.child, t.position, t.quaternion)
            return False
        return self.add(t.parent, t.child, t.t_ns, t.position, t.quaternion)

    def add_static(
        self, parent: str, child: str, position: npt.ArrayLike, quaternion: npt.ArrayLike
    ) -> None:
        """Take a fixed transform parent -> child.

        Raises
        ------
        PoseValueError
            If its position is not finite.
        RotationError
            If its quaternion is zero or not finite.
        """
        self._fixed.add(parent, child, position, quaternion)
        hand_eye = self._fixed.path(self.moving, self.sensor)
        if hand_eye is None:
            return
        # As in tf2 the newest holds: a sensor may be mounted anew.
        self._hand_eye, self._turn = hand_eye, matrix_to_quaternion(hand_eye[:3, :3])
        waiting, self._waiting = self._waiting, []
        for t_ns, (p, q) in waiting:
            self._append(t_ns, p, q)

    def add(
        self,
        parent: str,
        child: str,
        t_ns: int,
        position: npt.ArrayLike,
        quaternion: npt.ArrayLike,
    ) -> bool:
        """Take a transform parent -> child at a time.

        Returns
        -------
        bool
            Whether it is the robot's pose (others are passed over).

        Raises
        ------
        PoseError
            If it is not finite, time runs backwards or no arm gets there in the time (reported
            once a second); the track is unchanged.
        """
        if (parent, child) != (self.base, self.moving):
            if len(self._others) < _MOST_OTHERS:
                self._others[parent, child] = None
            return False
        p, q = np.asarray(position, np.float64), np.asarray(quaternion, np.float64)
        q = unit_pose(t_ns, p, q)
        if self._newest is not None and t_ns < self._newest[0]:
            # Also where the smoother has let all out: else poses of a new start would be lost.
            raise PoseOrderError.between(t_ns, self._newest[0])
        if self._jumps(t_ns, p):
            return False
        self._take(self._smoother.push(t_ns, (p, q)))
        self._count(t_ns, p)
        return True

    def finish(self) -> None:
        """No more poses will come for now: let out those that wait for neighbours."""
        self._take(self._smoother.finish())

    def forget_beyond(self, most: int) -> None:
        """Forget the older half of the poses where there are more than so many."""
        if len(self.track) > most:
            self.track.discard_before(int(self.track.times_ns[-most // 2]))
        if len(self._waiting) > most:
            del self._waiting[: -most // 2]

    def restart(self) -> None:
        """Forget all poses; fixed transforms stay, and poses that were given at once."""
        self._smoother.finish()
        self._waiting.clear()
        self.track.clear()
        if self._given is not None:
            self.track.assign(self._given)
        self._newest = self._rest = None

    def _jumps(self, t_ns: int, position: F64) -> bool:
        """Whether a pose is too far from the one before it.

        Raises
        ------
        PoseJumpError
            If so, and that was not reported within the last second.
        """
        if self._newest is None:
            return False
        elapsed_ns = t_ns - self._newest[0]
        away = math.dist(position, self._newest[1])
        if not 0 <= elapsed_ns < _BELIEVED_AFTER_NS:
            return False
        if away <= _SLACK_M + FASTEST_M_S * elapsed_ns * 1e-9:
            return False
        self.counts.jumps += 1
        if abs(t_ns - self._jump_told_ns) >= _TOLD_AGAIN_NS:
            self._jump_told_ns = t_ns
            raise PoseJumpError(
                f"pose at {t_ns * 1e-9:.6f} s is {away * 1e3:.1f} mm from the one "
                f"{elapsed_ns * 1e-6:.1f} ms before it, and left out; do two nodes publish "
                f"{self.base} -> {self.moving}?"
            )
        return True

    def _count(self, t_ns: int, position: F64) -> None:
        counts = self.counts
        counts.poses += 1
        first, last = self._span_ns or (t_ns, t_ns)
        self._span_ns = min(first, t_ns), max(last, t_ns)
        if self._newest is not None:
            gap_s = (t_ns - self._newest[0]) * 1e-9
            counts.gaps += gap_s > self.track.max_gap_s
            counts.longest_gap_s = max(counts.longest_gap_s, gap_s)
        self._newest = (t_ns, position)
        if self._rest is None or math.dist(position, self._rest[1]) >= REST_M:
            self._rest = self._newest

    def _take(self, poses: list[tuple[int, tuple[F64, F64]]]) -> None:
        if self._hand_eye is None:
            self._waiting += poses
            return
        for t_ns, (p, q) in poses:
            self._append(t_ns, p, q)

    def _append(self, t_ns: int, position: F64, quaternion: F64) -> None:
        fixed = self._hand_eye
        assert fixed is not None
        moved = _rigid(position, quaternion) @ fixed
        self.track.append(t_ns, moved[:3, 3], _product(quaternion, self._turn))


# One pose at a time, in plain Python: arrays of four numbers cost ten times as much. The same
# operations in the same order as `pose_matrix` and `multiply_quaternions`.


def _rigid(position: F64, quaternion: F64) -> F64:
    """The 4×4 matrix of one pose."""
    (px, py, pz), (x, y, z, w) = position.tolist(), quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), px],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), py],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), pz],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _product(a: F64, b: F64) -> list[float]:
    """Product of two quaternions: first `b` turns, then `a`."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a.tolist(), b.tolist()
    return [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
