"""Depth of a block from the sharpness of its votes, coarse to fine.

Over the full aperture, the whole crossing of the image, the sharpest plane is found to a fraction
of 0.1 mm, but relief that repeats has side lobes. Parts of the aperture have a short baseline each
and none; the sum of their evidence says where to search. Edges of the two polarities lie at
different heights of a wall, so each has a depth of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from ..rays import F32
from . import _kernels
from ._kernels import GRID_PX
from .surface_settings import SurfaceSettings


@dataclass(frozen=True)
class BlockRays:
    """Rays of a block in pixels of its grid.

    Attributes
    ----------
    rays : ndarray of float32, shape (n, 4)
        x, y on the plane at shift 0, px, and their slopes, px a metre; by polarity, and in that by
        part of the aperture.
    bounds : ndarray of int64, shape (2, parts + 1)
        Where the parts of OFF and of ON events begin and end.
    shape : tuple of int
        Rows and columns of the grid, px; multiples of `GRID_PX`.
    aperture : float
        Spread of the slopes along x that the rows were seen with.
    pixel_m : float
        Size of a pixel.
    """

    rays: F32
    bounds: npt.NDArray[np.int64]
    shape: tuple[int, int]
    aperture: float
    pixel_m: float

    @property
    def cells(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return self.shape[0] // GRID_PX, self.shape[1] // GRID_PX


@dataclass(frozen=True)
class Depths:
    """Depth of one polarity on the grid's cells, float32, shape (rows, columns).

    `shift` is metres from the middle plane, NaN where there is none; `x`, `y` is where in the
    neighbourhood the evidence lies, in cells.
    """

    shift: F32
    confidence: F32
    energy: F32
    x: F32
    y: F32


def arrange(
    rays: F32,
    polarity: npt.NDArray[np.uint8],
    left_m: float,
    length_m: float,
    pixel_m: float,
    settings: SurfaceSettings,
) -> tuple[BlockRays, float]:
    """Rays of a block on its grid, ordered; and the y of the grid's first row, metres.

    Parameters
    ----------
    rays : ndarray of float32, shape (n, 4)
        x, y and slopes, metres; at least one.
    polarity : ndarray of uint8, shape (n,)
        0 or 1.
    left_m : float
        x of the grid's first column.
    length_m : float
        Length of the grid.
    pixel_m : float
        Size of a pixel.
    settings : SurfaceSettings
        Number of parts.
    """
    parts = settings.sub_apertures
    top, bottom = float(rays[:, 1].min()), float(rays[:, 1].max())
    size = GRID_PX * pixel_m
    shape = (
        max(int(np.ceil((bottom - top) / size)), 2) * GRID_PX,
        max(int(np.ceil(length_m / size)), 2) * GRID_PX,
    )
    low, high = float(rays[:, 2].min()), float(rays[:, 2].max())
    share = (rays[:, 2] - low) / max(high - low, 1e-9)
    part = np.minimum((share * parts).astype(np.int64), parts - 1)
    key = (polarity > 0).astype(np.int64) * parts + part
    order = np.argsort(key, kind="stable")
    in_px = (rays[order] - np.array([left_m, top, 0, 0], np.float32)) / np.float32(pixel_m)
    edges = np.searchsorted(key[order], np.arange(2 * parts + 1))
    bounds = np.stack([edges[: parts + 1], edges[parts:]])
    return BlockRays(in_px.astype(np.float32), bounds, shape, high - low, pixel_m), top


def shifts(low_m: float, high_m: float, aperture: float, pixel_m: float, per_px: float) -> F64:
    """Planes over a range, spaced by parallax, one beyond either end."""
    count = int(np.clip(np.ceil((high_m - low_m) * aperture / pixel_m * per_px), 4, 2000)) + 1
    step = (high_m - low_m) / (count - 1)
    return np.asarray(low_m + step * (np.arange(count + 2) - 1), np.float64)


def find_depths(
    block: BlockRays, low_m: float, high_m: float, settings: SurfaceSettings
) -> list[Depths]:
    """Depth on the grid's cells of OFF and of ON events, between two shifts."""
    s = settings
    aperture = block.aperture
    coarse_at = shifts(low_m, high_m, aperture / s.sub_apertures, block.pixel_m, s.planes_per_px)
    coarse = np.empty((len(coarse_at), *block.cells), np.float32)
    _share(
        s.threads, len(coarse_at), lambda k: _score_parts(block, float(coarse_at[k]), coarse[k], s)
    )
    peak, contrast = np.empty(block.cells, np.float32), np.empty(block.cells, np.float32)
    everything = np.zeros(block.cells, np.int64)
    _kernels._find_peak(coarse, everything, everything + len(coarse_at), peak, contrast)
    middle = coarse_at[0] + peak * (coarse_at[1] - coarse_at[0])
    at = shifts(low_m, high_m, aperture, block.pixel_m, s.planes_per_px)
    step = at[1] - at[0]
    known = np.isfinite(middle)
    middle = np.where(known, middle, 0.0)
    first = np.where(known, np.ceil((middle - s.search_m - at[0]) / step), 1).astype(np.int64)
    last = np.where(known, np.floor((middle + s.search_m - at[0]) / step), 0).astype(np.int64)
    # Evidence and its moments along x and y.
    volume = np.empty((len(at), 3, *block.cells), np.float32)
    found = []
    for bounds in block.bounds:
        score = partial(_score, block, int(bounds[0]), int(bounds[-1]), s)
        _share(s.threads, len(at), lambda k, score=score: score(float(at[k]), volume[k]))  # type: ignore[misc]
        scores = volume[:, 0]
        _kernels._find_peak(scores, first, last, peak, contrast)
        nearest = np.nan_to_num(peak).round().astype(np.int64)[None]
        energy, x, y = (np.take_along_axis(volume[:, m], nearest, 0)[0] for m in range(3))
        weight = np.maximum(energy, 1e-12)
        shift = (at[0] + peak * step).astype(np.float32)
        shift[contrast < s.min_confidence] = np.nan
        found.append(Depths(shift, contrast.copy(), energy, x / weight, y / weight))
    return found


def _score_parts(block: BlockRays, shift: float, out: F32, s: SurfaceSettings) -> None:
    """Evidence of one plane, each part of the aperture for itself."""
    votes = np.empty(block.shape, np.float32)
    energy = np.zeros(block.cells, np.float32)
    for part in range(s.sub_apertures):
        votes[:] = 0
        for bounds in block.bounds:
            _kernels._vote(block.rays, bounds[part], bounds[part + 1], np.float32(shift), votes)
        _soften(votes)
        _kernels._add_energy(votes, energy)
    cv2.GaussianBlur(energy, (0, 0), s.coarse_sigma_px / GRID_PX, dst=out)


def _score(
    block: BlockRays, first: int, last: int, s: SurfaceSettings, shift: float, out: F32
) -> None:
    """Evidence of one plane and one polarity, and its moments, shape (3, rows, columns)."""
    votes = np.zeros(block.shape, np.float32)
    energy = np.zeros(block.cells, np.float32)
    _kernels._vote(block.rays, first, last, np.float32(shift), votes)
    _soften(votes)
    _kernels._add_energy(votes, energy)
    rows, columns = block.cells
    x = np.arange(columns, dtype=np.float32)[None, :]
    y = np.arange(rows, dtype=np.float32)[:, None]
    for moment, values in enumerate((energy, energy * x, energy * y)):
        out[moment] = cv2.GaussianBlur(values, (0, 0), s.sigma_px / GRID_PX)


def _soften(votes: F32) -> None:
    """A line one pixel wide would shine or fade with its place between pixels."""
    cv2.GaussianBlur(votes, (3, 3), 0.7, dst=votes)


def _share(threads: int, count: int, run: Callable[[int], None]) -> None:
    """Call `run` with 0 … count - 1, on some threads; each writes to a place of its own."""
    if threads == 1:
        for k in range(count):
            run(k)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, range(count)))
