"""The camera's place on the tool, from poses of the robot and of a target that stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from roller_core.errors import RollerError
from roller_core.transforms import F64, inverse_pose

#: Fewest pairs of poses; and the least turn that must occur about a second axis, degrees.
LEAST_PAIRS, LEAST_TURN_DEG = 3, 5.0
#: Residuals (root mean square) above which the poses can't belong together.
MOST_RESIDUAL_M, MOST_RESIDUAL_DEG = 2e-3, 1.0
#: Share by which the target's distances may be off where that makes most of the residuals, and what
#: is left of their squares then.
_MOST_SCALE, _LEFT = 0.01, 0.5
#: Standard deviation of that share above which a wrong pitch would not show; and what the pairs are
#: taken to be off by at least, metres.
_MOST_SCALE_DEVIATION, _LEAST_NOISE_M = 0.02, 2e-5
#: A degree counts as much as this length, metres: what it moves a surface 45 mm away.
_M_PER_RAD = 0.045


class HandEyeError(RollerError):
    """Poses from which the camera's place can't be found."""


@dataclass(frozen=True)
class HandEye:
    """Camera on the tool."""

    #: Camera optical frame in the tool's. Shape (4, 4).
    pose: F64
    #: The target in base. Shape (4, 4).
    target: F64
    #: How far each pair puts the target off its place. Shape (n,).
    residuals_m: F64
    residuals_deg: F64
    #: Standard deviation of the scale of the target's distances, had it to be found too.
    scale_deviation: float

    @property
    def rms_m(self) -> float:
        """Root mean square of the residuals, metres."""
        return float(np.sqrt(np.mean(self.residuals_m**2)))

    @property
    def rms_deg(self) -> float:
        """Root mean square of the residuals, degrees."""
        return float(np.sqrt(np.mean(self.residuals_deg**2)))


def find_hand_eye(tools: Sequence[F64], targets: Sequence[F64]) -> HandEye:
    """Camera on the tool from pairs of poses.

    OpenCV's `calibrateHandEye` (Park and Martin 1994) gives the start; least squares over all
    pairs bring it to where the target scatters least.

    Parameters
    ----------
    tools : sequence of ndarray, shape (4, 4)
        The tool in base, metres.
    targets : sequence of ndarray, shape (4, 4)
        The target in the camera at the same moments.

    Raises
    ------
    HandEyeError
        If there are too few pairs, the tool turns about one axis or one point alone, or the pairs
        don't agree, in their places or in their scale.
    """
    if len(tools) < LEAST_PAIRS:
        raise HandEyeError(f"{len(tools)} pairs of poses; {LEAST_PAIRS} are needed, 10 are better")
    base_tool, camera_target = np.asarray(tools, float), np.asarray(targets, float)
    _check_turns(base_tool)
    rotation, position = cv2.calibrateHandEye(
        list(base_tool[:, :3, :3]), list(base_tool[:, :3, 3]),
        list(camera_target[:, :3, :3]), list(camera_target[:, :3, 3]),
        method=cv2.CALIB_HAND_EYE_PARK,
    )  # fmt: skip
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = rotation, position.ravel()
    if not np.isfinite(start).all():
        raise HandEyeError("the pairs of poses have no solution: are they of the same moments?")
    placed = base_tool @ start @ camera_target
    target = np.eye(4)
    target[:3, :3] = Rotation.from_matrix(placed[:, :3, :3]).mean().as_matrix()
    target[:3, 3] = np.median(placed[:, :3, 3], axis=0)

    def residuals(change: F64) -> F64:
        seen = camera_target.copy()
        seen[:, :3, 3] *= 1.0 + (change[12] if len(change) > 12 else 0.0)
        found = base_tool @ _moved(start, change[:6]) @ seen
        apart = inverse_pose(_moved(target, change[6:12])) @ found
        turns = Rotation.from_matrix(apart[:, :3, :3]).as_rotvec()
        return np.concatenate([apart[:, :3, 3].ravel(), _M_PER_RAD * turns.ravel()])

    change = least_squares(residuals, np.zeros(12), x_scale="jac").x
    rest = residuals(change).reshape(2, -1, 3)
    scaled = least_squares(residuals, np.append(change, 0.0), x_scale="jac")
    found = HandEye(
        _moved(start, change[:6]),
        _moved(target, change[6:]),
        np.linalg.norm(rest[0], axis=1),
        np.degrees(np.linalg.norm(rest[1], axis=1) / _M_PER_RAD),
        _scale_deviation(scaled.jac, scaled.cost),
    )
    if found.rms_m > MOST_RESIDUAL_M or found.rms_deg > MOST_RESIDUAL_DEG:
        worst = int(np.argmax(found.residuals_m))
        raise HandEyeError(
            f"the pairs don't agree: the target is off its place by {found.rms_m * 1e3:.2f} mm and "
            f"{found.rms_deg:.2f}° (pair {worst + 1} most); are both poses of the same moment, "
            "tool in base and target in camera, and is the pitch of a grid right?"
        )
    if found.scale_deviation > _MOST_SCALE_DEVIATION:
        raise HandEyeError(
            "the tool turns nearly about one point: a wrong pitch of the grid or focal length "
            "would put the camera elsewhere and not show; between the poses move the tool too, "
            "nearer and farther and to the side, by 20 mm and more"
        )
    if abs(off := scaled.x[12]) > _MOST_SCALE and 2 * scaled.cost < _LEFT * np.sum(rest**2):
        raise HandEyeError(
            f"the target's distances are {abs(off):.1%} too {'short' if off > 0 else 'long'} for "
            "the robot's way: are the pitch of the grid and the camera's focal length right?"
        )
    return found


def _scale_deviation(jacobian: F64, cost: float) -> float:
    """Standard deviation of the scale of the target's distances, the last of the unknowns."""
    rows, unknowns = jacobian.shape
    own, others = jacobian[:, -1], jacobian[:, :-1]
    # What the others can't take over of what the scale does.
    alone = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
    noise = max(np.sqrt(2 * cost / (rows - unknowns)), _LEAST_NOISE_M)
    return float(noise / max(np.linalg.norm(alone), 1e-12))


def _moved(pose: F64, change: F64) -> F64:
    """A pose after a small move (m) and turn (rad) in its own frame."""
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(change[3:]).as_matrix()
    step[:3, 3] = change[:3]
    return np.asarray(pose @ step)


def _check_turns(tools: F64) -> None:
    """Refuse motions that leave the camera's place open."""
    first = tools[0, :3, :3]
    turns = Rotation.from_matrix(first.T @ tools[1:, :3, :3]).as_rotvec()
    size = np.degrees(np.linalg.svd(turns, compute_uv=False))
    if size[0] < LEAST_TURN_DEG:
        raise HandEyeError(
            f"the tool turns by {size[0]:.1f}° at most: turn it between the poses, by 20° and more"
        )
    if len(size) < 2 or size[1] < LEAST_TURN_DEG:
        raise HandEyeError(
            "the tool turns about one axis alone, which leaves the camera's place along it open: "
            "turn it about a second axis too"
        )
