"""Kinematics of the UR10: Denavit–Hartenberg parameters as Universal Robots publishes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.errors import RollerError
from roller_core.transforms import F64

JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
#: Most of each joint, rad/s, and the share of it that an example uses.
MOST_RAD_S = np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0])
SHARE = 0.5
#: No joint turns further to either side.
MOST_RAD = 2 * np.pi
#: An arm whose Jacobian's least singular value is below this is near a singularity.
_SINGULAR = 0.03
#: One whose elbow is straighter than this, as the sine of its angle, is so for being stretched out.
_STRETCHED = 0.2
_TWIST = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])


class KinematicsError(RollerError):
    """A place that the arm doesn't reach, or not in this way."""


@dataclass(frozen=True)
class Arm:
    """A UR arm."""

    #: Denavit–Hartenberg offsets and lengths. Length 6.
    d_m: tuple[float, ...]
    a_m: tuple[float, ...]

    def frames(self, joints_rad: F64) -> F64:
        """Base to each joint's frame and the flange, shape (7, 4, 4), metres."""
        out = [np.eye(4)]
        for q, d, a, twist in zip(joints_rad, self.d_m, self.a_m, _TWIST, strict=True):
            c, s, ct, st = np.cos(q), np.sin(q), np.cos(twist), np.sin(twist)
            link = [
                [c, -s * ct, s * st, a * c],
                [s, c * ct, -c * st, a * s],
                [0.0, st, ct, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
            out.append(out[-1] @ np.array(link))
        return np.array(out)

    def flange(self, joints_rad: F64) -> F64:
        """Flange in base, shape (4, 4), metres."""
        return np.asarray(self.frames(joints_rad)[-1])

    def jacobian(self, joints_rad: F64) -> F64:
        """Geometric Jacobian: velocity and turn of the flange by joint, shape (6, 6)."""
        frames = self.frames(joints_rad)
        axes, places = frames[:-1, :3, 2], frames[:-1, :3, 3]
        return np.vstack([np.cross(axes, frames[-1, :3, 3] - places).T, axes.T])

    def joints(self, flange: F64, near_rad: F64) -> F64:
        """Joint angles of a place of the flange, by Newton's method from ones nearby.

        Parameters
        ----------
        flange : ndarray, shape (4, 4)
            Flange in base, metres.
        near_rad : ndarray, shape (6,)
            Where to begin.

        Raises
        ------
        KinematicsError
            If it isn't reached, or only near a singularity.
        """
        q = np.array(near_rad, float)
        for _ in range(100):
            now = self.flange(q)
            turn = 0.5 * np.cross(now[:3, :3].T, flange[:3, :3].T).sum(axis=0)
            off = np.concatenate([flange[:3, 3] - now[:3, 3], turn])
            if np.abs(off).max() < 1e-10:
                break
            inverse = np.linalg.pinv(self.jacobian(q), rcond=1e-3)
            step = inverse @ off
            q += step * min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-12))
        else:
            raise KinematicsError(f"{_place(flange)} is out of reach from there")
        if np.linalg.svd(self.jacobian(q), compute_uv=False)[-1] < _SINGULAR:
            if abs(np.sin(q[2])) < _STRETCHED:
                raise KinematicsError(f"{_place(flange)} is out of reach: the arm is stretched out")
            raise KinematicsError("the arm is near a singularity there: start from another posture")
        return q


def _place(flange: F64) -> str:
    return ", ".join(f"{v:.3f}" for v in flange[:3, 3]) + " m (the flange in base)"


ARMS = {
    "ur10": Arm(
        (0.1273, 0.0, 0.0, 0.163941, 0.1157, 0.0922), (0.0, -0.612, -0.5723, 0.0, 0.0, 0.0)
    ),
    "ur10e": Arm(
        (0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655), (0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0)
    ),
}
