"""Votes of rays in a disparity space image.

The dense volume is the plain form, written as the paper describes it. The sweep gives the same
maxima without storing the volume: planes in the outer loop, one slice that stays in the cache,
a running maximum.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from numba import njit

from roller_core.camera import Camera
from roller_core.transforms import F64

from .rays import F32, RayBundle, plane_coefficients

U16 = npt.NDArray[np.uint16]


def dense_volume(rays: RayBundle, camera: Camera, planes: F64) -> F32:
    """Disparity space image of all planes.

    Parameters
    ----------
    rays : RayBundle
        Events in the reference view.
    camera : Camera
        Intrinsics and image size.
    planes : ndarray of float64, shape (n,)
        Depths, metres.

    Returns
    -------
    ndarray of float32, shape (n, height, width)
        Bilinear votes.
    """
    volume = np.zeros((len(planes), camera.height, camera.width), np.float32)
    scale, shift_u, shift_v = plane_coefficients(rays, camera, planes)
    for k in range(len(planes)):
        _vote_plane(rays.u, rays.v, rays.starts, scale[k], shift_u[k], shift_v[k], volume[k])
    return volume


def sweep_maximum(
    rays: RayBundle, camera: Camera, planes: F64, threads: int = 1
) -> tuple[F32, U16]:
    """Most votes along each pixel's ray and the plane that has them.

    Of planes with equal votes the nearest counts. The result doesn't depend on `threads`.

    Parameters
    ----------
    rays, camera, planes
        As for `dense_volume`; at most 65535 planes.
    threads : int
        Threads that share the planes.

    Returns
    -------
    votes : ndarray of float32, shape (height, width)
        The maximum; 0 where no ray passes.
    index : ndarray of uint16, shape (height, width)
        Plane of the maximum; 0 where no ray passes.
    """
    scale, shift_u, shift_v = plane_coefficients(rays, camera, planes)
    bounds = np.linspace(0, len(planes), threads + 1).astype(int)

    def run(first: int, last: int) -> tuple[F32, U16]:
        shape = (camera.height, camera.width)
        best, index = np.zeros(shape, np.float32), np.zeros(shape, np.uint16)
        plane = np.empty(shape, np.float32)
        _sweep(
            rays.u, rays.v, rays.starts, scale, shift_u, shift_v, first, last, plane, best, index
        )
        return best, index

    parts = [(int(a), int(b)) for a, b in pairwise(bounds) if b > a]
    if len(parts) == 1:
        return run(*parts[0])
    with ThreadPoolExecutor(len(parts)) as pool:
        results = list(pool.map(lambda part: run(*part), parts))
    best, index = results[0]
    for votes, planes_of in results[1:]:
        better = votes > best
        best[better] = votes[better]
        index[better] = planes_of[better]
    return best, index


@njit(cache=True, nogil=True, error_model="numpy")
def _vote_plane(u, v, starts, scale, shift_u, shift_v, plane):  # type: ignore[no-untyped-def]
    height, width = plane.shape
    right = np.float32(width - 1)
    bottom = np.float32(height - 1)
    for k in range(len(starts) - 1):
        a, bu, bv = scale[k], shift_u[k], shift_v[k]
        for i in range(starts[k], starts[k + 1]):
            x = u[i] * a + bu
            y = v[i] * a + bv
            # Written so that NaN fails it.
            if x >= 0 and x < right and y >= 0 and y < bottom:
                xi = int(x)
                yi = int(y)
                fx = x - np.float32(xi)
                fy = y - np.float32(yi)
                gx = np.float32(1) - fx
                gy = np.float32(1) - fy
                plane[yi, xi] += gx * gy
                plane[yi, xi + 1] += fx * gy
                plane[yi + 1, xi] += gx * fy
                plane[yi + 1, xi + 1] += fx * fy


@njit(cache=True, nogil=True)
def _sweep(u, v, starts, scale, shift_u, shift_v, first, last, plane, best, index):  # type: ignore[no-untyped-def]
    flat = plane.reshape(-1)
    flat_best = best.reshape(-1)
    flat_index = index.reshape(-1)
    for k in range(first, last):
        plane[:] = 0
        _vote_plane(u, v, starts, scale[k], shift_u[k], shift_v[k], plane)
        number = np.uint16(k)
        for i in range(flat.size):
            votes = flat[i]
            better = votes > flat_best[i]
            flat_best[i] = votes if better else flat_best[i]
            flat_index[i] = number if better else flat_index[i]
