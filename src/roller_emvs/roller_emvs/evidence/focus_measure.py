"""Sharpness of the votes by plane and cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.bands import Bands, sort_into_bands
from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _kernels as kernels
from . import _meet_kernels as meet
from ._kernels import CELL_PX, ROW_PX, TILE_CELLS
from .field import RayField

I64 = npt.NDArray[np.int64]
I32 = npt.NDArray[np.int32]

#: Planes at most.
_MOST_PLANES = 500
#: Rows of a band, px: its votes fit a core's nearest cache.
BAND_ROWS = 16


def plane_offsets(low: float, high: float, parallax_px: float, per_px: float) -> F64:
    """Planes over a range of offsets, spaced by parallax, one beyond either end."""
    count = int(np.clip(np.ceil(parallax_px * per_px), 4, _MOST_PLANES - 1)) + 1
    step = (high - low) / (count - 1)
    return np.asarray(low + step * (np.arange(count + 2) - 1), np.float64)


def sort_rays(field: RayField, polarity: int, ends: tuple[float, float]) -> Bands:
    """Rays of a polarity in the bands of rows that they reach between two offsets."""
    own = slice(field.bounds[polarity], field.bounds[polarity + 1])
    return sort_into_bands(field.rays[own], ends, field.shape, BAND_ROWS, (0.5, 0.5))


@dataclass(frozen=True)
class Sorted:
    """Rays of each band in groups."""

    #: As of `Bands`. Shape (4, m).
    rays: F32
    #: Where each group begins and the last ends. Shape (bands, groups + 1).
    starts: I64


def by_part(bands: Bands, least: float, width: float, parts: int) -> Sorted:
    """Rays by part of the aperture, of `width` in slope each, the first from `least` on."""
    part = np.empty(bands.rays.shape[1], np.int32)
    slopes = np.float32(least), np.float32(1.0 / width)
    kernels._part_of(bands.rays[2], *slopes, parts, part)
    return _grouped(bands, part, parts)


def by_plane(bands: Bands, near: F32, at: F64) -> Sorted:
    """Rays by the plane nearest to the offset on cells, NaN where there is none, that they meet."""
    plane = np.empty(bands.rays.shape[1], np.int32)
    offsets = np.float32(at[0]), np.float32(at[1] - at[0])
    meet._plane_near(bands.rays, near, *offsets, len(at), plane)
    return _grouped(bands, plane, len(at))


def _grouped(bands: Bands, group: I32, groups: int) -> Sorted:
    out = np.empty_like(bands.rays)
    starts = np.empty((len(bands.starts) - 1, groups + 1), np.int64)
    kernels._order_groups(bands.rays, group, bands.starts, starts, out)
    return Sorted(out, starts)


def focus_measure_by_plane(
    rays: Sorted, field: RayField, at: F64, reach: int, tiles: I64, threads: int = 1
) -> F32:
    """Sharpness of the votes by plane and cell, not yet summed over neighbourhoods.

    Parameters
    ----------
    rays : Sorted
        By plane, or all in the first of them.
    field : RayField
        Grid.
    at : ndarray of float64, shape (planes,)
        Offsets of the planes.
    reach : int
        Planes to either side of their own on which rays vote.
    tiles : ndarray of int64, shape (bands, tiles, 2)
        First and last plane on which tiles count; see `tiles_searched`, `tiles_reached`.
    threads : int
        Threads that share the bands.

    Returns
    -------
    ndarray of float32, shape (planes, rows, columns)
        Sums of squared slopes along x.
    """
    measure = np.zeros((len(at), *field.cells), np.float32)
    offsets = at.astype(np.float32)

    def run(first: int) -> None:
        votes = np.zeros((BAND_ROWS // ROW_PX + 1, field.shape[1]), np.float32)
        line = np.zeros(field.shape[1], np.float32)
        kernels._measure_bands(
            rays.rays, rays.starts, first, threads, reach, offsets, tiles, votes,
            kernels.chunk(), line, measure,
        )  # fmt: skip

    share(threads, threads, run)
    return measure


def everywhere(rays: F32, begins: I64, ends: I64, planes: int) -> Sorted:
    """Rays between two places in each band, shape (bands,), to vote on all planes."""
    starts = np.repeat(ends[:, None], planes + 1, axis=1)
    starts[:, 0] = begins
    return Sorted(rays, starts)


def tiles_searched(field: RayField, first: I32, last: I32, planes: int) -> I64:
    """First and last plane of each band's tiles, from those of their cells; last < first: none."""
    tiles = all_tiles(field, planes)
    tiles[:] = planes, -1
    kernels._tiles_searched(first, last, BAND_ROWS // CELL_PX, tiles)
    return tiles


def tiles_reached(rays: Sorted, field: RayField, at: F64) -> I64:
    """All planes, but none for tiles that no ray reaches."""
    tiles = all_tiles(field, len(at))
    seen = np.zeros(tiles.shape[:2], np.bool_)
    kernels._tiles_reached(rays.rays, rays.starts[:, 0], rays.starts[:, -1], at[0], at[-1], seen)
    tiles[~seen, 1] = -1
    return tiles


def all_tiles(field: RayField, planes: int) -> I64:
    """First and last plane of each band's tiles, shape (bands, tiles, 2), where all count."""
    bands, count = -(-field.shape[0] // BAND_ROWS), -(-field.cells[1] // TILE_CELLS)
    tiles = np.zeros((bands, count, 2), np.int64)
    tiles[..., 1] = planes - 1
    return tiles
