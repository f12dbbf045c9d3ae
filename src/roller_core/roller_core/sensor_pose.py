"""The sensor's pose from transforms between named frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .pose_smoothing import StampSmoother
from .pose_track import PoseJumpError, PoseTrack, PoseValueError, unit_pose
from .transforms import (
    F64,
    inverse_pose,
    matrix_to_quaternion,
    multiply_quaternions,
    pose_matrix,
    unit_quaternion,
)

#: Poses on either side of one over which its stamp is smoothed.
DEFAULT_SMOOTHING = 4
#: No arm moves its tool faster; what does comes from somewhere else.
_FASTEST_M_S = 5.0
_SLACK_M = 1e-3
#: A pose this much later is believed wherever it is, ns.
_BELIEVED_AFTER_NS = 500_000_000
_TOLD_AGAIN_NS = 1_000_000_000


@dataclass(slots=True)
class PoseCounts:
    """What came of the robot's poses.

    Parameters
    ----------
    poses : int
        Poses taken.
    gaps : int
        Times that two of them lay further apart than may be interpolated over.
    longest_gap_s : float
        Longest time between two of them.
    jumps : int
        Poses left out because no arm gets there in the time.
    """

    poses: int = 0
    gaps: int = 0
    longest_gap_s: float = 0.0
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
        Neighbours on either side over which the stamps of the robot's poses are smoothed; a pose
        is in the track when that many have followed it. See `StampSmoother`.
    """

    def __init__(
        self,
        base: str = "base",
        moving: str = "tool0_controller",
        sensor: str = "event_camera_optical_frame",
        max_gap_s: float = 0.1,
        smoothing: int = DEFAULT_SMOOTHING,
    ) -> None:
        self.base = base
        self.moving = moving
        self.sensor = sensor
        self.track = PoseTrack(max_gap_s)
        self.counts = PoseCounts()
        self._newest: tuple[int, F64] | None = None
        self._jump_told_ns = -(2**62)
        self._static: dict[str, dict[str, F64]] = {}
        self._hand_eye: F64 | None = np.eye(4) if moving == sensor else None
        self._waiting: list[tuple[int, tuple[F64, F64]]] = []
        self._smoother: StampSmoother[tuple[F64, F64]] = StampSmoother(smoothing)

    @property
    def hand_eye(self) -> F64 | None:
        """Transform moving frame -> sensor, shape (4, 4); None while not known."""
        return self._hand_eye

    @property
    def has_robot_poses(self) -> bool:
        """Whether any pose of the moving frame came."""
        return bool(self._waiting or len(self.track))

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
        if not np.all(np.isfinite(position)):
            # Here, as every pose after it would be refused without a word of the mounting.
            raise PoseValueError(f"fixed transform {parent} -> {child} is not finite; left out")
        matrix = pose_matrix(position, unit_quaternion(quaternion))
        self._static.setdefault(parent, {})[child] = matrix
        self._static.setdefault(child, {})[parent] = inverse_pose(matrix)
        if self._hand_eye is None:
            self._hand_eye = self._find(self.moving, self.sensor)
            if self._hand_eye is not None:
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
            If it is not finite, time runs backwards or no arm gets there in the time (told once a
            second); the track is unchanged.
        """
        if (parent, child) != (self.base, self.moving):
            return False
        p, q = np.asarray(position, np.float64), np.asarray(quaternion, np.float64)
        q = unit_pose(t_ns, p, q)
        if self._jumps(t_ns, p):
            return False
        self._take(self._smoother.push(t_ns, (p, q)))
        self._count(t_ns, p)
        return True

    def finish(self) -> None:
        """No more poses will come for now: let out those that wait for neighbours."""
        self._take(self._smoother.finish())

    def restart(self) -> None:
        """Forget all poses; fixed transforms stay."""
        self._smoother.finish()
        self._waiting.clear()
        self.track.clear()
        self._newest = None

    def _jumps(self, t_ns: int, position: F64) -> bool:
        """Whether a pose is too far from the one before it.

        Raises
        ------
        PoseJumpError
            If so, and that was not told within the last second.
        """
        if self._newest is None:
            return False
        elapsed_ns = t_ns - self._newest[0]
        away = float(np.linalg.norm(position - self._newest[1]))
        if not 0 <= elapsed_ns < _BELIEVED_AFTER_NS:
            return False
        if away <= _SLACK_M + _FASTEST_M_S * elapsed_ns * 1e-9:
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
        if self._newest is not None:
            gap_s = (t_ns - self._newest[0]) * 1e-9
            counts.gaps += gap_s > self.track.max_gap_s
            counts.longest_gap_s = max(counts.longest_gap_s, gap_s)
        self._newest = (t_ns, position)

    def _take(self, poses: list[tuple[int, tuple[F64, F64]]]) -> None:
        if self._hand_eye is None:
            self._waiting += poses
            return
        for t_ns, (p, q) in poses:
            self._append(t_ns, p, q)

    def _append(self, t_ns: int, position: F64, quaternion: F64) -> None:
        fixed = self._hand_eye
        assert fixed is not None
        moved = pose_matrix(position, quaternion) @ fixed
        rotation = multiply_quaternions(quaternion, matrix_to_quaternion(fixed[:3, :3]))
        self.track.append(t_ns, moved[:3, 3], rotation)

    def _find(self, start: str, goal: str) -> F64 | None:
        found = {start: np.eye(4)}
        queue = [start]
        for frame in queue:
            for child, matrix in self._static.get(frame, {}).items():
                if child not in found:
                    found[child] = found[frame] @ matrix
                    queue.append(child)
        return found.get(goal)
