"""Loops over poses; `PoseTrack.matrices` is a twin, the other is in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _count_up_to


@njit(cache=True, nogil=True, error_model="numpy")
def _matrices(times, positions, quaternions, t_ns, out):  # type: ignore[no-untyped-def]
    """Interpolated poses as matrices, shape (n, 4, 4), at times between the first and the last."""
    last = len(times) - 1
    q = np.empty(4)
    for n in range(len(t_ns)):
        # Of equal times the later one; the last step serves its end too.
        k = min(max(_count_up_to(times, t_ns[n]) - 1, 0), max(last - 1, 0))
        after = min(k + 1, last)
        # Subtract whole numbers: epoch nanoseconds don't fit a float64 exactly.
        step = times[after] - times[k]
        fraction = (t_ns[n] - times[k]) / step if step > 0 else 0.0
        dot = 0.0
        for i in range(4):
            dot += quaternions[k, i] * quaternions[after, i]
        angle = np.arccos(min(abs(dot), 1.0))
        sine = np.sin(angle)
        w0, w1 = 1.0 - fraction, fraction
        if sine >= 1e-9:
            w0, w1 = np.sin(w0 * angle) / sine, np.sin(w1 * angle) / sine
        w1 = w1 if dot >= 0 else -w1
        square = 0.0
        for i in range(4):
            q[i] = w0 * quaternions[k, i] + w1 * quaternions[after, i]
            square += q[i] * q[i]
        length = np.sqrt(square)
        x, y, z, w = q[0] / length, q[1] / length, q[2] / length, q[3] / length
        m = out[n]
        m[0, 0], m[0, 1], m[0, 2] = (
            1 - 2 * (y * y + z * z),
            2 * (x * y - z * w),
            2 * (x * z + y * w),
        )
        m[1, 0], m[1, 1], m[1, 2] = (
            2 * (x * y + z * w),
            1 - 2 * (x * x + z * z),
            2 * (y * z - x * w),
        )
        m[2, 0], m[2, 1], m[2, 2] = (
            2 * (x * z - y * w),
            2 * (y * z + x * w),
            1 - 2 * (x * x + y * y),
        )
        for i in range(3):
            m[i, 3] = positions[k, i] + fraction * (positions[after, i] - positions[k, i])
            m[3, i] = 0.0
        m[3, 3] = 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _seen(inverse_view, poses, k, k_inverse, h, centres):  # type: ignore[no-untyped-def]
    """Homographies at infinity K·R·K^-1 of poses in a view, and their centres, rounded."""
    r, kr = np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(poses)):
        for i in range(3):
            for j in range(4):
                total = 0.0
                for m in range(4):
                    total += inverse_view[i, m] * poses[n, m, j]
                if j < 3:
                    r[i, j] = total
                else:
                    centres[n, i] = total
        for i in range(3):
            for j in range(3):
                kr[i, j] = k[i, 0] * r[0, j] + k[i, 1] * r[1, j] + k[i, 2] * r[2, j]
        for i in range(3):
            for j in range(3):
                h[n, i, j] = (
                    kr[i, 0] * k_inverse[0, j]
                    + kr[i, 1] * k_inverse[1, j]
                    + kr[i, 2] * k_inverse[2, j]
                )
