"""The sensor's pose from transforms between named frames."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .pose_smoothing import StampSmoother
from .pose_track import PoseTrack, PoseValueError, unit_pose
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
            If it is not finite or time runs backwards; the track is unchanged.
        """
        if (parent, child) != (self.base, self.moving):
            return False
        p, q = np.asarray(position, np.float64), np.asarray(quaternion, np.float64)
        self._take(self._smoother.push(t_ns, (p, unit_pose(t_ns, p, q))))
        return True

    def finish(self) -> None:
        """No more poses will come for now: let out those that wait for neighbours."""
        self._take(self._smoother.finish())

    def restart(self) -> None:
        """Forget all poses; fixed transforms stay."""
        self._smoother.finish()
        self._waiting.clear()
        self.track.clear()

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
