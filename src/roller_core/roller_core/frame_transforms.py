"""Transforms between named frames: as messages have them, and paths along fixed ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .outputs import stamp_ns
from .pose_track import PoseValueError
from .transforms import F64, inverse_pose, pose_matrix, unit_quaternion


@dataclass(frozen=True, slots=True)
class Transform:
    """A transform from a frame to another."""

    #: Frames, without leading slashes.
    parent: str
    child: str
    #: ROS time, ns.
    t_ns: int
    #: Metres. Length 3.
    position: tuple[float, float, float]
    #: x, y, z, w. Length 4.
    quaternion: tuple[float, float, float, float]
    #: Whether it holds for all times (/tf_static).
    static: bool = False


def transforms_of(message: Any, static: bool) -> Iterator[Transform]:
    """Transforms of a tf2_msgs/TFMessage, of a live graph or of a bag."""
    for item in message.transforms:
        t, r = item.transform.translation, item.transform.rotation
        yield Transform(
            item.header.frame_id.lstrip("/"),
            item.child_frame_id.lstrip("/"),
            stamp_ns(item),
            (t.x, t.y, t.z),
            (r.x, r.y, r.z, r.w),
            static,
        )


class FixedFrames:
    """Fixed transforms between frames, which may be gone along in either direction."""

    def __init__(self) -> None:
        self._neighbours: dict[str, dict[str, F64]] = {}

    def add(
        self, parent: str, child: str, position: npt.ArrayLike, quaternion: npt.ArrayLike
    ) -> None:
        """Take the transform parent -> child.

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
        self._neighbours.setdefault(parent, {})[child] = matrix
        self._neighbours.setdefault(child, {})[parent] = inverse_pose(matrix)

    def path(self, start: str, goal: str) -> F64 | None:
        """Transform start -> goal, shape (4, 4); None where no path leads there."""
        found = {start: np.eye(4)}
        queue = [start]
        for frame in queue:
            for child, matrix in self._neighbours.get(frame, {}).items():
                if child not in found:
                    found[child] = found[frame] @ matrix
                    queue.append(child)
        return found.get(goal)
