"""Sums over Gaussian neighbourhoods, where there is something to sum and somebody asks."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from roller_emvs.rays import F32

from . import _blur_kernels as kernels


def blurred(
    volume: F32, sigma: float | tuple[float, float], wanted: npt.NDArray[np.int32] | None = None
) -> F32:
    """Planes of a grid, each summed over a neighbourhood as `cv2.GaussianBlur` does.

    Faster, as planes are of few rows that hold something, and of those few are wanted.

    Parameters
    ----------
    volume : ndarray of float32, shape (planes, rows, columns)
        The planes.
    sigma : float or tuple of float
        Deviation of the Gaussian: in rows and in columns, if they differ.
    wanted : ndarray of int32, shape (rows, 2), optional
        First and last plane on which a row is wanted; what others become isn't defined. Without
        it all are.
    """
    planes, rows, columns = volume.shape
    down, across = sigma if isinstance(sigma, tuple) else (sigma, sigma)
    weights = _weights(down), _weights(across)
    size = (rows + len(weights[0]) - 1) * (columns + len(weights[1]) - 1)
    if wanted is None:
        wanted = np.empty((rows, 2), np.int32)
        wanted[:] = 0, planes - 1
    out, buffers = np.empty_like(volume), np.empty((3, size), np.float32)
    kernels._blur(
        volume, weights, wanted, np.empty(rows, np.bool_), np.empty((rows, 2), np.int64),
        (buffers[0], buffers[1], buffers[2]), out,
    )  # fmt: skip
    return out


@lru_cache(maxsize=16)
def _weights(sigma: float) -> F32:
    """Those of OpenCV, which reach four deviations."""
    size = round(sigma * 8 + 1) | 1
    return np.asarray(cv2.getGaussianKernel(size, sigma, cv2.CV_32F)[:, 0], np.float32)
