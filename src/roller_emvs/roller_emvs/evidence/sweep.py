"""Depth on a grid of cells from the sharpness of votes, coarse to fine.

The squared slopes of the votes summed over a neighbourhood are largest on the plane on which the
warped events are sharpest: local contrast maximisation (Gallego et al., CVPR 2018) on the planes
of a disparity space image. Over a wide aperture relief that repeats has side lobes. Parts of the
aperture have a short baseline each and none; the sum of their evidence says where to search.
Edges of the two polarities lie at different heights of a wall, so each has a depth of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from ..bands import sort_into_bands
from ..rays import F32
from ..threads import share
from . import _kernels as kernels
from . import _peak_kernels as peaks
from ._kernels import CELL_PX, ROW_PX, TILE_CELLS
from .creep import creep_depth_m
from .field import RayField
from .settings import EvidenceSettings
from .viewing import viewing

#: Rows of a band, px: its votes fit a core's nearest cache.
BAND_ROWS = 16
#: Energy of a single vote, in half of which its squared slopes end for a spot between pixels.
_SPOT = 1.0
#: Spots of as many events as a pixel needs, below whose energy a peak may be chance.
_SPOTS = 8
#: Columns that move by less than this, in cells, stay where they are.
_STILL = 0.05
I64 = npt.NDArray[np.int64]
I32 = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Depths:
    """Depth of one polarity on the grid's cells, float32, shape (rows, columns).

    `shift` is NaN where there is none; `x`, `y` is where in the neighbourhood the evidence lies,
    in cells.
    """

    shift: F32
    confidence: F32
    energy: F32
    x: F32
    y: F32


def plane_shifts(low: float, high: float, parallax_px: float, per_px: float, most: int) -> F64:
    """Planes over a range of shifts, spaced by parallax, one beyond either end."""
    count = int(np.clip(np.ceil(parallax_px * per_px), 4, most - 1)) + 1
    step = (high - low) / (count - 1)
    return np.asarray(low + step * (np.arange(count + 2) - 1), np.float64)


def find_depths(
    field: RayField, low: float, high: float, settings: EvidenceSettings
) -> list[Depths]:
    """Depth on the grid's cells of OFF and of ON events, between two shifts.

    Parameters
    ----------
    field : RayField
        Rays of a window or block.
    low, high : float
        The range of shifts.
    settings : EvidenceSettings
        Planes, neighbourhoods, thresholds.
    """
    s = settings
    parallax = field.aperture * (high - low)
    at = plane_shifts(low, high, parallax, s.planes_per_px, s.max_planes)
    step = at[1] - at[0]
    everywhere = np.zeros(field.cells, np.int32), np.full(field.cells, len(at) - 1, np.int32)
    near: F32 | None = None
    first, last = everywhere
    reach = len(at)
    if s.sub_apertures > 1:
        near = _coarse_shift(field, low, high, s)
        reach = int(np.ceil(s.search_px * s.planes_per_px))
        number = np.nan_to_num((near - at[0]) / step, nan=-1e6).round().astype(np.int32)
        first, last = number - reach, number + reach
    found: list[Depths | None] = [None, None]

    def look(k: int) -> None:
        rays = field.rays[field.bounds[k] : field.bounds[k + 1]]
        energy = _energy(rays, field, at, s, near, reach, (first, last))
        depths = _peaks(_follow(energy, field, at), at, first, last, field, s)
        found[k] = _checked(field, depths, k, high - low, s)

    share(s.threads, 2, look)
    return [f for f in found if f is not None]


def _checked(
    field: RayField, depths: Depths, polarity: int, span: float, s: EvidenceSettings
) -> Depths:
    """Depths whose own events have parallax, with their creep taken out.

    Events that saw a place from one side alone, as those of a hot pixel do, have none.
    """
    seen = viewing(field, depths.shift, polarity)
    shift = np.where(seen.spread * span < s.min_parallax_px, np.float32(np.nan), depths.shift)
    # A depth errs by the inverse of its parallax.
    share = np.sqrt(np.minimum(seen.spread / max(field.aperture, 1e-12), 1.0))
    if s.creep_m and polarity == s.creep_polarity:
        depth_m = creep_depth_m(field, seen, s.dead_time_s) * s.creep_m
        shift += (depth_m * field.shift_per_m).astype(np.float32)
    confidence = depths.confidence * share
    shift = np.where(confidence < s.min_seen_confidence, np.float32(np.nan), shift)
    return replace(depths, shift=shift, confidence=confidence)


def _coarse_shift(field: RayField, low: float, high: float, s: EvidenceSettings) -> F32:
    """Shift from the parts of the aperture, each for itself; NaN where none is found."""
    parallax = field.aperture * (high - low) / s.sub_apertures
    at = plane_shifts(low, high, parallax, s.planes_per_px, s.max_planes)
    slope = field.rays[:, 2]
    least, most = float(field.slopes[0].min()), float(field.slopes[1].max())
    width = max(most - least, 1e-12) / s.sub_apertures
    part = np.clip((slope - least) / width, 0, s.sub_apertures - 1).astype(np.int64)
    everywhere = np.zeros(field.cells, np.int32), np.full(field.cells, len(at) - 1, np.int32)
    total = np.zeros((len(at), *field.cells), np.float32)
    for polarity in (0, 1):
        own = slice(field.bounds[polarity], field.bounds[polarity + 1])
        for k in range(s.sub_apertures):
            rays = field.rays[own][part[own] == k]
            if len(rays):
                total += _energy(rays, field, at, s, None, len(at), everywhere)
    peak, contrast, top = (np.empty(field.cells, np.float32) for _ in range(3))
    scores = _blur(total, s.coarse_sigma_px)
    peaks._find_peak(scores, *everywhere, 2.0, 0.0, s.min_coarse_confidence, peak, contrast, top)
    return (at[0] + peak * (at[1] - at[0])).astype(np.float32)


def _energy(
    rays: F32,
    field: RayField,
    at: F64,
    s: EvidenceSettings,
    near: F32 | None,
    reach: int,
    searched: tuple[I32, I32],
) -> F32:
    """Sharpness of the votes by plane and cell, not yet summed over neighbourhoods."""
    energy = np.zeros((len(at), *field.cells), np.float32)
    if not len(rays):
        return energy
    ends = (float(at[0]), float(at[-1]))
    bands = sort_into_bands(rays, ends, field.shape, BAND_ROWS, (0.5, 0.5))
    ordered, starts = _order_by_plane(bands.rays, bands.starts, at, near)
    tiles = _searched_tiles(ordered, starts, field, at, s, searched, near is not None)
    # Polarities are shared already.
    threads = max(s.threads // 2, 1)

    def run(first: int) -> None:
        votes = np.zeros((BAND_ROWS // ROW_PX + 1, field.shape[1]), np.float32)
        line = np.zeros(field.shape[1], np.float32)
        kernels._energy_bands(
            ordered, starts, first, threads, reach, at.astype(np.float32), tiles, votes,
            kernels.chunk(), line, energy,
        )  # fmt: skip

    share(threads, threads, run, inner=True)
    return energy


def _follow(energy: F32, field: RayField, at: F64) -> F32:
    """Energy of each column along the middle of the rays it was seen by.

    A column at the image's border was seen from one side alone. From plane to plane its edges
    move as well as blur, and the sharpest plane at a fixed place would not be that of an edge.
    """
    offsets = field.middles[None, :] * at[:, None] / CELL_PX
    if np.abs(offsets).max() < _STILL:
        return energy
    out = np.empty_like(energy)
    peaks._shear(energy, offsets, out)
    return out


def _order_by_plane(rays: F32, edges: I64, at: F64, near: F32 | None) -> tuple[F32, I64]:
    """Rays of each band by the plane they are searched around; where each plane's begin.

    Without coarse shifts all are searched everywhere.
    """
    bands = len(edges) - 1
    starts = np.empty((bands, len(at) + 1), np.int64)
    if near is None:
        starts[:] = edges[1:, None]
        starts[:, 0] = edges[:-1]
        return rays, starts
    plane = np.empty(rays.shape[1], np.int64)
    kernels._plane_near(rays, near, np.float32(at[0]), np.float32(at[1] - at[0]), len(at), plane)
    out = np.empty_like(rays)
    kernels._order_planes(rays, plane, edges, starts, out)
    return out, starts


def _searched_tiles(
    rays: F32,
    starts: I64,
    field: RayField,
    at: F64,
    s: EvidenceSettings,
    searched: tuple[I32, I32],
    local: bool,
) -> npt.NDArray[np.int64]:
    """First and last plane of each band's tiles, shape (bands, tiles, 2); last < first: none."""
    columns = field.cells[1]
    per_band = BAND_ROWS // CELL_PX
    bands, count = len(starts), -(-columns // TILE_CELLS)
    tiles = np.zeros((bands, count, 2), np.int64)
    tiles[..., 1] = len(at) - 1
    if not s.tiles:
        return tiles
    if local:
        first, last = searched
        for t in range(count):
            span = slice(t * TILE_CELLS, (t + 1) * TILE_CELLS)
            for b in range(bands):
                own = slice(b * per_band, (b + 1) * per_band)
                none = last[own, span] < 0
                tiles[b, t, 0] = np.where(none, len(at), first[own, span]).min()
                tiles[b, t, 1] = np.where(none, -1, last[own, span]).max()
        return tiles
    seen = np.zeros((bands, count), np.bool_)
    kernels._tiles_reached(rays, starts[:, 0], starts[:, -1], at[0], at[-1], seen)
    tiles[~seen, 1] = -1
    return tiles


def _peaks(
    energy: F32, at: F64, first: I32, last: I32, field: RayField, s: EvidenceSettings
) -> Depths:
    """Sharpest plane of each cell and where its evidence lies."""
    scores = _blur(energy, s.sigma_px)
    peak, contrast, top, total, x, y = (np.empty(field.cells, np.float32) for _ in range(6))
    sigma = s.sigma_px / CELL_PX
    weakest = _SPOTS * _SPOT * s.min_votes**2 / (2 * np.pi * sigma**2)
    limits = (s.max_rival, weakest, s.min_confidence)
    peaks._find_peak(scores, first, last, *limits, peak, contrast, top)
    # A column that was in view over little parallax has depth in name only.
    parallax = field.apertures * np.float32(at[-2] - at[1])
    peak[:, parallax < s.min_parallax_px] = np.nan
    shift = (at[0] + peak * (at[1] - at[0])).astype(np.float32)
    nearest = np.nan_to_num(peak, nan=-1.0).round().astype(np.int64)
    reach = int(np.ceil(2.5 * sigma))
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    peaks._centroids(energy, nearest, weights, total, x, y)
    x += np.nan_to_num(shift) * field.middles[None, :].astype(np.float32) / CELL_PX
    return Depths(shift, contrast, total, x, y)


def _blur(volume: F32, sigma_px: float) -> F32:
    """Sum each plane over a neighbourhood."""
    out = np.zeros_like(volume)
    for plane, blurred in zip(volume, out, strict=True):
        if cv2.countNonZero(plane):
            cv2.GaussianBlur(plane, (0, 0), sigma_px / CELL_PX, dst=blurred)
    return out
