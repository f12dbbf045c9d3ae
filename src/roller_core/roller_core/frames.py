"""The sensor's pose from transforms between named frames."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .pose_track import PoseTrack
from .transforms import (
    F64,
    inverse_pose,
    matrix_to_quaternion,
    multiply_quaternions,
    pose_matrix,
    unit_quaternion,
)


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
    """

    def __init__(
        self,
        base: str = "base",
        moving: str = "tool0_controller",
        sensor: str = "event_camera_optical_frame",
        max_gap_s: float = 0.1,
    ) -> None:
        self.base = base
        self.moving = moving
        self.sensor = sensor
        self.track = PoseTrack(max_gap_s)
        self._static: dict[str, dict[str, F64]] = {}
        self._hand_eye: F64 | None = np.eye(4) if moving == sensor else None
        self._waiting: list[tuple[int, F64, F64]] = []

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
        """Take a fixed transform parent -> child."""
        matrix = pose_matrix(position, unit_quaternion(quaternion))
        self._static.setdefault(parent, {})[child] = matrix
        self._static.setdefault(child, {})[parent] = inverse_pose(matrix)
        if self._hand_eye is None:
            self._hand_eye = self._find(self.moving, self.sensor)
            if self._hand_eye is not None:
                waiting, self._waiting = self._waiting, []
                for item in waiting:
                    self._append(*item)

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
        if self._hand_eye is None:
            self._waiting.append((t_ns, p, q))
        else:
            self._append(t_ns, p, q)
        return True

    def _append(self, t_ns: int, position: F64, quaternion: F64) -> None:
        fixed = self._hand_eye
        assert fixed is not None
        length = np.linalg.norm(quaternion)
        if not np.isfinite(length) or length < 1e-9:
            self.track.append(t_ns, position, quaternion)  # refused there, with the reason
            return
        q = quaternion / length
        moved = pose_matrix(position, q) @ fixed
        rotation = multiply_quaternions(q, matrix_to_quaternion(fixed[:3, :3]))
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
