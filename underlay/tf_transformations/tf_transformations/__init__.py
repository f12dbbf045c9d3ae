"""Rotations as quaternions and homogeneous matrices, with the names a ROS distribution has.

Quaternions are (x, y, z, w), as in ROS messages; matrices are 4 x 4 and homogeneous. Code written
against this module runs unchanged on the `tf_transformations` of a ROS 2 distribution, of which
this is the part the workspace needs, built on transforms3d (whose quaternions are (w, x, y, z)).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from transforms3d import axangles, euler, quaternions

Array = npt.NDArray[np.float64]

__all__ = [
    "concatenate_matrices",
    "euler_from_matrix",
    "euler_from_quaternion",
    "euler_matrix",
    "identity_matrix",
    "inverse_matrix",
    "quaternion_about_axis",
    "quaternion_conjugate",
    "quaternion_from_euler",
    "quaternion_from_matrix",
    "quaternion_inverse",
    "quaternion_matrix",
    "quaternion_multiply",
    "quaternion_slerp",
    "rotation_matrix",
    "translation_from_matrix",
    "translation_matrix",
    "unit_vector",
    "vector_norm",
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


def identity_matrix() -> Array:
    """Return the 4 x 4 identity."""
    return np.identity(4)


def translation_matrix(direction: npt.ArrayLike) -> Array:
    """Return the matrix that translates by `direction` (3 values)."""
    matrix = np.identity(4)
    matrix[:3, 3] = np.asarray(direction, dtype=np.float64)[:3]
    return matrix


def translation_from_matrix(matrix: npt.ArrayLike) -> Array:
    """Return the translation (3 values) of a 4 x 4 matrix."""
    return np.array(matrix, dtype=np.float64)[:3, 3].copy()


def rotation_matrix(
    angle: float, direction: npt.ArrayLike, point: npt.ArrayLike | None = None
) -> Array:
    """Return the matrix that rotates by `angle` about the axis `direction` through `point`.

    Parameters
    ----------
    angle
        Radians.
    direction
        The axis, of any length but zero.
    point
        A point on the axis; the origin by default.
    """
    matrix = _homogeneous(axangles.axangle2mat(unit_vector(direction), angle))
    if point is not None:
        centre = np.asarray(point, dtype=np.float64)[:3]
        matrix[:3, 3] = centre - matrix[:3, :3] @ centre
    return matrix


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


def quaternion_from_matrix(matrix: npt.ArrayLike, isprecise: bool = False) -> Array:
    """Return the quaternion of a rotation matrix.

    `isprecise` is there for the signature's sake; the way that stands small errors is always used.
    """
    del isprecise
    return _xyzw(quaternions.mat2quat(np.asarray(matrix, dtype=np.float64)[:3, :3]))


def quaternion_multiply(quaternion1: npt.ArrayLike, quaternion0: npt.ArrayLike) -> Array:
    """Return quaternion1 * quaternion0: first quaternion0 is applied, then quaternion1."""
    return _xyzw(quaternions.qmult(_wxyz(quaternion1), _wxyz(quaternion0)))


def quaternion_conjugate(quaternion: npt.ArrayLike) -> Array:
    """Return the conjugate of a quaternion."""
    return _xyzw(quaternions.qconjugate(_wxyz(quaternion)))


def quaternion_inverse(quaternion: npt.ArrayLike) -> Array:
    """Return the inverse of a quaternion."""
    # Not transforms3d's own, which is right for quaternions of length one only.
    vector = np.asarray(quaternion, dtype=np.float64)
    return quaternion_conjugate(vector) / float(np.dot(vector, vector))


def quaternion_slerp(
    quat0: npt.ArrayLike,
    quat1: npt.ArrayLike,
    fraction: float,
    spin: int = 0,
    shortestpath: bool = True,
) -> Array:
    """Return the rotation a fraction of the way from quat0 to quat1, at constant speed.

    Parameters
    ----------
    quat0, quat1
        Start and end.
    fraction
        0 gives quat0, 1 gives quat1.
    spin
        Half turns to add on the way.
    shortestpath
        Whether to take quat1 or its negative, whichever is nearer (they are the same rotation).
    """
    start, end = unit_vector(quat0), unit_vector(quat1)
    if fraction == 0.0:
        return start
    if fraction == 1.0:
        return end
    cosine = float(np.dot(start, end))
    if abs(abs(cosine) - 1.0) < _TINY:
        return start
    if shortestpath and cosine < 0.0:
        cosine = -cosine
        end = -end
    angle = math.acos(min(1.0, max(-1.0, cosine))) + spin * math.pi
    if abs(angle) < _TINY:
        return start
    weighted = math.sin((1.0 - fraction) * angle) * start + math.sin(fraction * angle) * end
    return weighted / math.sin(angle)


def vector_norm(data: npt.ArrayLike, axis: int | None = None) -> float | Array:
    """Return the Euclidean length of an array, or of its vectors along an axis."""
    norm = np.sqrt(np.sum(np.square(np.asarray(data, dtype=np.float64)), axis=axis))
    return float(norm) if axis is None else norm


def unit_vector(data: npt.ArrayLike, axis: int | None = None, out: Array | None = None) -> Array:
    """Return an array scaled to length one, as a whole or along an axis.

    Parameters
    ----------
    data
        A vector, or several.
    axis
        The axis along which the vectors lie; by default all of `data` is one vector.
    out
        Where to put the result, if not in a new array.
    """
    vectors = np.array(data, dtype=np.float64)
    length = np.sqrt(np.sum(vectors * vectors, axis=axis, keepdims=axis is not None))
    result = vectors / length
    if out is None:
        return result
    out[...] = result
    return out
