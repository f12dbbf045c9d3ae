"""Rigid transforms in float64: unit quaternions in the order x, y, z, w and 4×4 matrices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .errors import RollerError

F64 = npt.NDArray[np.float64]


class RotationError(RollerError):
    """A quaternion that stands for no rotation."""


def unit_quaternion(quaternion: npt.ArrayLike) -> F64:
    """Normalise quaternions.

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        x, y, z, w of any length but zero.

    Raises
    ------
    RotationError
        If one is zero or not finite.
    """
    q = np.asarray(quaternion, dtype=np.float64)
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    if not np.all(np.isfinite(q)) or np.any(length < 1e-9):
        raise RotationError("a quaternion is zero or not finite; expected x, y, z, w of a rotation")
    return q / length


def quaternion_to_matrix(quaternion: npt.ArrayLike) -> F64:
    """Rotation matrices, shape (..., 3, 3), of unit quaternions, shape (..., 4)."""
    q = np.asarray(quaternion, dtype=np.float64)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    # Twice the products of any two components.
    a, b, c = 2.0 * x, 2.0 * y, 2.0 * z
    xx, xy, xz, xw, yy, yz, yw, zz, zw = (
        a * x,
        a * y,
        a * z,
        a * w,
        b * y,
        b * z,
        b * w,
        c * z,
        c * w,
    )
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - (yy + zz), xy - zw, xz + yw
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = xy + zw, 1 - (xx + zz), yz - xw
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = xz - yw, yz + xw, 1 - (xx + yy)
    return out


def matrix_to_quaternion(rotation: npt.ArrayLike) -> F64:
    """Unit quaternion, shape (4,), of one rotation matrix, shape (3, 3).

    Takes the largest of the four components first (Shepperd 1978), so no rotation is badly
    conditioned.
    """
    m = np.asarray(rotation, dtype=np.float64)
    trace = np.trace(m)
    squares = np.array([m[0, 0], m[1, 1], m[2, 2], trace])
    k = int(np.argmax(squares))
    q = np.empty(4)
    if k == 3:
        q[:] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + trace
    else:
        i, j, n = k, (k + 1) % 3, (k + 2) % 3
        q[i] = 1 + 2 * m[i, i] - trace
        q[j] = m[j, i] + m[i, j]
        q[n] = m[n, i] + m[i, n]
        q[3] = m[n, j] - m[j, n]
    return q / np.linalg.norm(q)


def rotation_vector_to_quaternion(vector: npt.ArrayLike) -> F64:
    """Unit quaternion, shape (4,), of axis times angle in radians, shape (3,)."""
    v = np.asarray(vector, dtype=np.float64)
    half = 0.5 * float(np.linalg.norm(v))
    # sinc keeps the limit at angle zero exact: sin(h) / (2 h) -> 1/2.
    return np.append(v * (0.5 * np.sinc(half / np.pi)), np.cos(half))


def multiply_quaternions(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    """Hamilton product of quaternions, shape (..., 4): first `b` turns, then `a`."""
    ax, ay, az, aw = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bx, by, bz, bw = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def slerp(q0: F64, q1: F64, fraction: F64) -> F64:
    """Spherical interpolation along the shorter arc (Shoemake 1985).

    Parameters
    ----------
    q0, q1 : ndarray, shape (n, 4)
        Unit quaternions; `q` and `-q` are the same rotation.
    fraction : ndarray, shape (n,)
        0 gives `q0`, 1 gives `q1`.
    """
    dot = np.einsum("ij,ij->i", q0, q1)
    angle = np.arccos(np.minimum(np.abs(dot), 1.0))
    sine = np.sin(angle)
    near = sine < 1e-9
    sine[near] = 1.0
    w0 = np.where(near, 1.0 - fraction, np.sin((1.0 - fraction) * angle) / sine)
    w1 = np.copysign(np.where(near, fraction, np.sin(fraction * angle) / sine), dot)
    q = w0[:, None] * q0 + w1[:, None] * q1
    return np.asarray(q / np.sqrt(np.einsum("ij,ij->i", q, q))[:, None], np.float64)


def pose_matrix(position: npt.ArrayLike, quaternion: npt.ArrayLike) -> F64:
    """4×4 matrices, shape (..., 4, 4), of positions (..., 3) and unit quaternions (..., 4)."""
    p = np.asarray(position, dtype=np.float64)
    matrix = np.zeros((*p.shape[:-1], 4, 4))
    matrix[..., :3, :3] = quaternion_to_matrix(quaternion)
    matrix[..., :3, 3] = p
    matrix[..., 3, 3] = 1.0
    return matrix


def inverse_pose(matrix: npt.ArrayLike) -> F64:
    """Inverse of rigid 4×4 matrices, shape (..., 4, 4)."""
    m = np.asarray(matrix, dtype=np.float64)
    rotation_t = np.swapaxes(m[..., :3, :3], -1, -2)
    out = np.zeros_like(m)
    out[..., :3, :3] = rotation_t
    out[..., :3, 3] = -(rotation_t @ m[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out
