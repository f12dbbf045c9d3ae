"""Votes of rays in a disparity space image, and the best plane along each pixel's ray.

The dense volume is the plain form, written as the paper describes it. The sweep gives the same
maxima without storing the volume: bands of rows, planes in the loop, a running maximum; what it
touches stays in the cache, and bands that no ray reaches are skipped.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.transforms import F64
from roller_emvs.bands import I64, Bands, sort_into_bands
from roller_emvs.rays import F32, RayBundle
from roller_emvs.threads import share

from . import _packed_kernels as packed
from . import _view_kernels as view_kernels
from . import _vote_kernels as kernels

U16 = npt.NDArray[np.uint16]

#: Rows of a band: with its planes' votes and running maxima it fits a core's cache.
BAND_ROWS = 16
#: Parts of a vote below which shares of it are told too coarsely.
_LEAST_WHOLE = 2
#: Rows that a bilinear vote reaches, with a margin for rounding.
_REACH = (0.01, 1.01)


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
    inverse = (1.0 / planes).astype(np.float32)
    for k in range(len(planes)):
        kernels._vote_plane(rays.rays, rays.limits, inverse[k], volume[k])
    return volume


def sweep_maximum(
    rays: RayBundle, camera: Camera, planes: F64, threads: int = 1
) -> tuple[F32, U16]:
    """Most votes along each pixel's ray and the plane that has them.

    Of planes with equal votes the nearest counts. The result doesn't depend on `threads`,
    and equals the maximum of the dense volume to the bit.

    Parameters
    ----------
    rays, camera, planes
        As for `dense_volume`; at most 65535 planes.
    threads : int
        Threads that share the bands.

    Returns
    -------
    votes : ndarray of float32, shape (height, width)
        The maximum; 0 where no ray passes.
    index : ndarray of uint16, shape (height, width)
        Plane of the maximum; 0 where no ray passes.
    """
    shape = (camera.height, camera.width)
    inverse = 1.0 / np.asarray(planes)
    votes, index = np.zeros(shape, np.float32), np.zeros(shape, np.uint16)
    if shape[1] < 2:  # a vote is shared by two columns
        return votes, index
    bands, limits = _bands(rays, inverse, shape, BAND_ROWS, 0, threads)

    def run(first: int) -> None:
        best = np.empty((BAND_ROWS, shape[1]), np.float32)
        kernels._sweep_bands(
            bands.rays, limits, bands.starts, first, threads, inverse.astype(np.float32),
            np.zeros((BAND_ROWS + 4, shape[1]), np.float32), kernels.chunk(), best,
            np.empty(best.shape, np.int32), votes, index,
        )  # fmt: skip

    share(threads, threads, run)
    return votes, index


def sweep_views(
    rays: RayBundle,
    camera: Camera,
    planes: F64,
    half_shifts: I64,
    threads: int = 1,
    least: tuple[float, int] = (0.0, 0),
) -> tuple[F32, U16] | None:
    """Maxima in several views from the votes of one, for views shifted along the image's rows.

    Views with parallel axes and centres on a line along u share their planes: what one sees at
    pixel x on plane k, the other sees at x + shift. Votes are those of each view's own sweep where
    the shifts are whole or half pixels, but that the four shares of a vote are rounded, to 1/255
    where no more than 60 rays reach a tile of 32 columns in a row; see `_packed_kernels`.

    Parameters
    ----------
    rays, camera, planes, threads
        As for `sweep_maximum`; at most 32767 planes.
    half_shifts : ndarray of int64, shape (views, planes)
        Pixel x of a view is pixel x + half_shifts / 2 of the view that the rays are in.
    least : tuple of float and int
        Votes, and pixels: what lies farther than these from any pixel with more votes may hold none
        or fewer.

    Returns
    -------
    votes, index : ndarray, shape (views, height, width)
        As of `sweep_maximum`. None where so many rays reach a tile that shares can't be told.
    """
    shape = (camera.height, camera.width)
    inverse = 1.0 / np.asarray(planes)
    pad = int(np.abs(half_shifts).max()) // 2 + 2
    rows, wide = BAND_ROWS, shape[1] + 2 * pad
    bands, limits = _bands(rays, inverse, shape, rows, pad, threads)
    tiles = (wide >> packed.TILE_BITS) + 1
    reached = np.zeros((len(bands.starts) - 1, rows + 1, tiles), np.int32)
    ends = np.float32(inverse.min()), np.float32(inverse.max())

    def look(first: int) -> None:
        chunk = packed.chunk()
        packed._count_reached(bands.rays, bands.starts, first, threads, ends, chunk, reached)

    share(threads, threads, look)
    if packed._whole(int(reached.max())) < _LEAST_WHOLE:
        return None
    active = _active(reached, half_shifts, least)
    views = len(half_shifts)
    votes = np.empty((views, *shape), np.float32)
    index = np.empty((views, *shape), np.uint16)

    def run(first: int) -> None:
        view_kernels._sweep_bands_views(
            bands.rays, limits, bands.starts, first, threads, inverse.astype(np.float32),
            half_shifts, pad, reached, active, np.zeros((2, rows + 2, 2, wide), np.int32),
            packed.chunk(), np.empty((2, 2, wide), np.int32), view_kernels.runs(rows, tiles),
            np.empty((views, rows, shape[1]), np.int32), votes, index,
        )  # fmt: skip

    share(threads, threads, run)
    return votes, index


def _active(
    reached: npt.NDArray[np.int32], half_shifts: I64, least: tuple[float, int]
) -> npt.NDArray[np.uint8]:
    """Tiles of each band's rows that are looked at, by the rays that reach them; see `sweep_views`.

    A pixel has no more votes than rays reach its tile in its row and the row above. On another
    plane it lies in another place of the view that is voted in.
    """
    counts = reached[:, :-1] + reached[:, 1:]
    most, near = least
    if most <= 0:
        return (counts > 0).view(np.uint8)
    across = near + int(np.ptp(half_shifts, axis=1).max()) // 2 + 1
    beside = -(-across >> packed.TILE_BITS)
    around = np.ones((2 * near + 1, 2 * beside + 1), np.uint8)
    some = (counts > most).view(np.uint8).reshape(-1, counts.shape[2])
    return np.asarray(cv2.dilate(some, around).reshape(counts.shape) * (counts > 0), np.uint8)


def _bands(
    rays: RayBundle, inverse: F64, shape: tuple[int, int], rows: int, pad: int, threads: int
) -> tuple[Bands, F32]:
    """Rays by band, moved by `pad` columns, and their limits; none if no plane reaches any."""
    ends = (float(inverse.min()), float(inverse.max()))
    padded = (shape[0], shape[1] + 2 * pad)
    limited = len(rays) > 0 and bool(rays.limits.min() <= ends[1])
    bands = sort_into_bands(rays.rays, ends, padded, rows, _REACH, pad, threads, limited)
    return bands, rays.limits[bands.source]
