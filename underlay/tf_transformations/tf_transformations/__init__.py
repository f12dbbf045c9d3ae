"""Rotations as quaternions and homogeneous matrices, with the names a ROS distribution has.

Quaternions are (x, y, z, w), as in ROS messages; matrices are 4 x 4 and homogeneous. Code written
against this module runs unchanged on the `tf_transformations` of a ROS 2 distribution, of which
this is the part the workspace needs, built on transforms3d (whose quaternions are (w, x, y, z)).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from transforms3d import euler, quaternions

Array = npt.NDArray[np.float64]

__all__ = [
    "concatenate_matrices",
    "euler_from_matrix",
    "euler_from_quaternion",
    "euler_matrix",
    "inverse_matrix",
    "quaternion_about_axis",
    "quaternion_from_euler",
    "quaternion_from_matrix",
    "quaternion_inverse",
    "quaternion_matrix",
    "quaternion_multiply",
    "quaternion_slerp",
    "translation_from_matrix",
    "translation_matrix",
]

_TINY = np.finfo(np.float64).eps * 4.0


def _wxyz(quaternion: npt.ArrayLike) -> Array:
    """Put the scalar first, as transforms3d has it."""
    x, y, z, w = np.asarray(quaternion, dtype=np.float64)
    return np.array([w, x, y, z])


def _xyzw(quaternion: npt.ArrayLike) -> Array:
    """Put the scalar last, as ROS has it."""
    w, x, y, z = np.asarray(quaternion, dtype=np.float64)
    return np.array([x, y, z, w])


def _homogeneous(rotation: npt.ArrayLike) -> Array:
    """Make a 4 x 4 matrix of a 3 x 3 rotation."""
    matrix = np.identity(4)
    matrix[:3, :3] = rotation
    return matrix


def translation_matrix(direction: npt.ArrayLike) -> Array:
    """Return the matrix that translates by `direction` (3 values)."""
    matrix = np.identity(4)
    matrix[:3, 3] = np.asarray(direction, dtype=np.float64)[:3]
    return matrix


def translation_from_matrix(matrix: npt.ArrayLike) -> Array:
    """Return the translation (3 values) of a 4 x 4 matrix."""
    return np.array(matrix, dtype=np.float64)[:3, 3].copy()


def inverse_matrix(matrix: npt.ArrayLike) -> Array:
    """Return the inverse of a square matrix."""
    return np.linalg.inv(np.asarray(matrix, dtype=np.float64))


def concatenate_matrices(*matrices: npt.ArrayLike) -> Array:
    """Return the product of matrices, left to right."""
    product = np.identity(4)
    for matrix in matrices:
        product = product @ np.asarray(matrix, dtype=np.float64)
    return product


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: str = "sxyz") -> Array:
    """Return the quaternion of Euler angles (radians).

    Parameters
    ----------
    ai, aj, ak
        First, second and third angle; roll, pitch and yaw by default.
    axes
        Static (s) or rotating (r) axes and their order, one of transforms3d's 24.
    """
    return _xyzw(euler.euler2quat(ai, aj, ak, axes=axes))


def euler_from_quaternion(
    quaternion: npt.ArrayLike, axes: str = "sxyz"
) -> tuple[float, float, float]:
    """Return the Euler angles (radians) of a quaternion."""
    return euler.quat2euler(_wxyz(quaternion), axes=axes)


def euler_matrix(ai: float, aj: float, ak: float, axes: str = "sxyz") -> Array:
    """Return the rotation matrix of Euler angles (radians)."""
    return _homogeneous(euler.euler2mat(ai, aj, ak, axes=axes))


def euler_from_matrix(matrix: npt.ArrayLike, axes: str = "sxyz") -> tuple[float, float, float]:
    """Return the Euler angles (radians) of a rotation matrix."""
    return euler.mat2euler(np.asarray(matrix, dtype=np.float64)[:3, :3], axes=axes)


def quaternion_about_axis(angle: float, axis: npt.ArrayLike) -> Array:
    """Return the quaternion that rotates by `angle` (radians) about `axis`."""
    return _xyzw(quaternions.axangle2quat(np.asarray(axis, dtype=np.float64), angle))


def quaternion_matrix(quaternion: npt.ArrayLike) -> Array:
    """Return the rotation matrix of a quaternion."""
    return _homogeneous(quaternions.quat2mat(_wxyz(quaternion)))


def quaternion_from_matrix(matrix: npt.ArrayLike) -> Array:
    """Return the quaternion of a rotation matrix."""
    return _xyzw(quaternions.mat2quat(np.asarray(matrix, dtype=np.float64)[:3, :3]))


def quaternion_multiply(quaternion1: npt.ArrayLike, quaternion0: npt.ArrayLike) -> Array:
    """Return quaternion1 * quaternion0: first quaternion0 is applied, then quaternion1."""
    return _xyzw(quaternions.qmult(_wxyz(quaternion1), _wxyz(quaternion0)))


def quaternion_inverse(quaternion: npt.ArrayLike) -> Array:
    """Return the inverse of a quaternion."""
    # Not transforms3d's own, which is right for quaternions of length one only.
    vector = np.asarray(quaternion, dtype=np.float64)
    return vector * (-1.0, -1.0, -1.0, 1.0) / float(np.dot(vector, vector))


def quaternion_slerp(quat0: npt.ArrayLike, quat1: npt.ArrayLike, fraction: float) -> Array:
    """Return the rotation a fraction (0 to 1) from quat0 to quat1, by the shorter path."""
    start, end = (np.asarray(q, dtype=np.float64) / np.linalg.norm(q) for q in (quat0, quat1))
    cosine = float(np.dot(start, end))
    angle = math.acos(min(1.0, abs(cosine)))
    if angle < _TINY:
        return start
    # A quaternion and its negative are the same rotation.
    end = math.copysign(1.0, cosine) * end
    weighted = math.sin((1.0 - fraction) * angle) * start + math.sin(fraction * angle) * end
    return np.asarray(weighted / math.sin(angle))
