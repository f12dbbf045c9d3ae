"""Depth on a grid of cells from the sharpness of votes, coarse to fine.

The squared slopes of the votes summed over a neighbourhood are largest on the plane on which the
warped events are sharpest: local contrast maximisation (Gallego et al., CVPR 2018) on the planes
of a disparity space image. Over a wide aperture relief that repeats has side lobes. Parts of the
aperture have a short baseline each and none; the sum of their evidence says where to search.
Edges of the two polarities lie at different heights of a wall, so each has a depth of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roller_core.transforms import F64
from roller_emvs.bands import Bands
from roller_emvs.rays import F32, MIN_PARALLAX_PX
from roller_emvs.threads import share

from . import _peak_kernels as peaks
from ._kernels import CELL_PX
from .blur import blurred
from .coarse import coarse_offset, coarse_planes
from .evidence_settings import EvidenceSettings
from .field import Box, EvidenceField, RayField, sample_median
from .focus_measure import (
    I32,
    by_plane,
    everywhere,
    focus_measure_by_plane,
    plane_offsets,
    sort_rays,
    tiles_reached,
    tiles_searched,
)
from .slope_statistics import crossing_change, slope_statistics

#: The fine depth is searched this far to either side of the coarse one, px of parallax.
_SEARCH_PX = 8.0
#: Share of the highest peak from which on another makes it ambiguous; tuned on the virtual cell.
_MOST_RIVAL = 0.9
#: Focus measure of a single vote, half of which is left of a spot between pixels.
_SPOT = 1.0
#: Spots, and events in each, below whose focus measure a peak may be chance.
_SPOTS, _SPOT_VOTES = 8, 4
#: Spread of slopes, in that of an even spread over the aperture, from which on its middle saw next
#: to nothing; with events at the two ends alone it is the root of 3. Where the middle saw little
#: anywhere, as behind a mask, the median spread counts.
_TWO_SIDED, _MOST_UNEVEN = 1.2, 1.1
#: Columns that move by less than this, in cells, stay where they are.
_STILL = 0.05


@dataclass(frozen=True)
class Depths:
    """Depth of one polarity on the grid's cells, float32, shape (rows, columns).

    `offset` is NaN where there is none; `x`, `y` is where in the neighbourhood the evidence lies,
    in cells; `change` see `crossing_change`.
    """

    offset: F32
    confidence: F32
    focus_measure: F32
    x: F32
    y: F32
    change: F32

    @classmethod
    def none(cls, cells: tuple[int, int]) -> Depths:
        """No depth anywhere."""
        nothing = np.zeros(cells, np.float32)
        return cls(np.full(cells, np.float32(np.nan)), *[nothing] * 5)

    def cut(self, box: Box) -> Depths:
        """Those of some of the cells."""
        values = (self.offset, self.confidence, self.focus_measure, self.x, self.y, self.change)
        offset, confidence, measure, x, y, change = (v[box] for v in values)
        return Depths(offset, confidence, measure, x - box[1].start, y - box[0].start, change)

    def put(self, cells: tuple[int, int], box: Box) -> Depths:
        """The same as part of a larger grid, elsewhere without a depth."""
        found = Depths.none(cells)
        values = [found.offset, *np.zeros((5, *cells), np.float32)]
        own = self.offset, self.confidence, self.focus_measure, self.x, self.y, self.change
        for whole, part in zip(values, own, strict=True):
            whole[box] = part
        values[3][box] += np.float32(box[1].start)
        values[4][box] += np.float32(box[0].start)
        return Depths(*values)


def find_depths(
    field: RayField,
    low: float,
    high: float,
    settings: EvidenceSettings,
    parts: int = 1,
    threads: int = 1,
) -> list[Depths]:
    """Depth on the grid's cells of OFF and of ON events, between two offsets.

    Parameters
    ----------
    field : RayField
        Rays of a window or block.
    low, high : float
        The range of offsets.
    settings : EvidenceSettings
        Planes, neighbourhoods, thresholds.
    parts : int
        Parts of the aperture whose evidence says where to search; 1 searches everywhere.
    threads : int
        Threads that share the work.
    """
    s = settings
    at = plane_offsets(low, high, field.aperture * (high - low), s.planes_per_px)
    first, last = np.zeros(field.cells, np.int32), np.full(field.cells, len(at) - 1, np.int32)
    ends = (float(at[0]), float(at[-1]))
    near: F32 | None = None
    bands: list[Bands | None] = [None, None]

    def sort(k: int) -> None:
        bands[k] = sort_rays(field, k, ends)

    if parts > 1:
        coarse = coarse_planes(field, low, high, parts, s.planes_per_px)
        ends = (float(coarse[0]), float(coarse[-1]))
        share(threads, 2, sort)
        near = coarse_offset(field, [b for b in bands if b is not None], coarse, parts, threads)
        first, last, reach = planes_near(near, at, s)
    found: list[Depths | None] = [None, None]

    def look(k: int) -> None:
        own = bands[k] or sort_rays(field, k, ends)
        if near is None:
            rays = everywhere(own.rays, own.starts[:-1], own.starts[1:], len(at))
            tiles, reached = tiles_reached(rays, field, at), len(at)
        else:
            rays = by_plane(own, near, at)
            tiles, reached = tiles_searched(field, first, last, len(at)), reach
        # Polarities are shared already.
        measure = focus_measure_by_plane(rays, field, at, reached, tiles, max(threads // 2, 1))
        found[k] = sharpest(field, measure, at, first, last, k, s)

    share(threads, 2, look)
    return [f for f in found if f is not None]


def planes_near(near: F32, at: F64, settings: EvidenceSettings) -> tuple[I32, I32, int]:
    """First and last plane around a coarse offset, by cell, and how many lie to either side.

    Where the offset is NaN both lie before all planes.
    """
    reach = int(np.ceil(_SEARCH_PX * settings.planes_per_px))
    between = (near - at[0]) / (at[1] - at[0])
    number = np.rint(np.where(np.isnan(between), -1e6, between)).astype(np.int32)
    return number - reach, number + reach, reach


def sharpest(
    field: EvidenceField,
    measure: F32,
    at: F64,
    first: I32,
    last: I32,
    polarity: int,
    settings: EvidenceSettings,
) -> Depths:
    """Depth of a polarity from the sharpness of its votes.

    Parameters
    ----------
    field : EvidenceField
        Events.
    measure : ndarray of float32, shape (planes, rows, columns)
        Focus measure by cell; it is moved in its place, see `_follow`.
    at : ndarray of float64, shape (planes,)
        Offsets of the planes, one beyond either end of the range.
    first, last : ndarray of int32, shape (rows, columns)
        Planes between which each cell is searched.
    polarity : int
        0 for OFF, 1 for ON events.
    settings : EvidenceSettings
        Neighbourhoods, thresholds.
    """
    most = _follow(measure, field, at)
    span = float(at[-2] - at[1])
    # Blurred is the most on any plane: no cell's score is above that.
    sigma = settings.sigma_px / CELL_PX
    possible = blurred(most[None], sigma)[0] >= _weakest(settings)
    last = np.where(possible, last, np.int32(-1))
    cut = field.cut_around(possible, int(np.ceil(4 * sigma)))
    if cut is None:
        depths = _peaks(measure, at, first, last, field, settings)
        return _checked(field, depths, polarity, span, settings)
    part, box = cut
    own = np.ascontiguousarray(measure[:, box[0], box[1]])
    first, last = (np.ascontiguousarray(v[box]) for v in (first, last))
    depths = _peaks(own, at, first, last, part, settings)
    return _checked(part, depths, polarity, span, settings).put(field.cells, box)


def _weakest(s: EvidenceSettings) -> float:
    """Score below which a peak may be chance."""
    sigma = s.sigma_px / CELL_PX
    return float(_SPOTS * _SPOT * _SPOT_VOTES**2 / (2 * np.pi * sigma**2))


def _checked(
    field: EvidenceField, depths: Depths, polarity: int, span: float, s: EvidenceSettings
) -> Depths:
    """Depths whose own events have parallax.

    Events that saw a place from one side alone, as those of a hot pixel do, have none. Those that
    saw it from both sides and hardly from between are of two edges that come to lie on each other.
    """
    seen = slope_statistics(field, depths.offset, polarity)
    even = seen.spread / np.maximum(field.apertures, np.float32(1e-12))
    widest = _MOST_UNEVEN * (
        sample_median(np.where(np.isfinite(depths.offset), even, np.nan)) or 0.0
    )
    refused = (seen.spread * span < MIN_PARALLAX_PX) | (even > max(_TWO_SIDED, widest))
    offset = np.where(refused, np.float32(np.nan), depths.offset)
    # A depth errs by the inverse of its parallax.
    share = np.sqrt(np.minimum(seen.spread / max(field.aperture, 1e-12), 1.0))
    confidence = depths.confidence * share
    offset = np.where(confidence < s.min_seen_confidence, np.float32(np.nan), offset)
    change = crossing_change(field, seen)
    return replace(depths, offset=offset, confidence=confidence, change=change)


def _follow(measure: F32, field: EvidenceField, at: F64) -> F32:
    """Move the measure to the middle of the rays that saw each column, and return its most there.

    A column at the image's border was seen from one side alone. From plane to plane its edges
    move as well as blur, and the sharpest plane at a fixed place would not be that of an edge.
    """
    moved = field.middles[None, :] * at[:, None] / CELL_PX
    if np.abs(moved).max() < _STILL:
        return np.asarray(measure.max(axis=0), np.float32)
    most = np.zeros(field.cells, np.float32)
    peaks._shear(measure, moved, most)
    return most


def _peaks(
    measure: F32, at: F64, first: I32, last: I32, field: EvidenceField, s: EvidenceSettings
) -> Depths:
    """Sharpest plane of each cell and where its evidence lies."""
    sigma = s.sigma_px / CELL_PX
    wanted = np.empty((len(first), 2), np.int32)
    peaks._rows_searched(first, last, wanted)
    # A peak's parabola takes in the planes beside it.
    scores = blurred(measure, sigma, wanted + np.array([-1, 1], np.int32))
    peak, contrast, top, total, x, y = (np.empty(field.cells, np.float32) for _ in range(6))
    limits = (_MOST_RIVAL, _weakest(s), s.min_confidence)
    peaks._find_peak(scores, first, last, *limits, peak, contrast, top)
    # A column that was in view over little parallax has depth in name only.
    parallax = field.apertures * np.float32(at[-2] - at[1])
    peak[:, parallax < MIN_PARALLAX_PX] = np.nan
    offset = (at[0] + peak * (at[1] - at[0])).astype(np.float32)
    in_effect = field.planes_in_effect(at)
    if in_effect is not None:
        peaks._top_between(scores, in_effect, peak, offset)
    reach = int(np.ceil(2.5 * sigma))
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (steps / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    peaks._centroids(measure, peak, weights, total, x, y)
    known = np.where(np.isnan(offset), np.float32(0), offset)
    x += known * (field.middles / CELL_PX).astype(np.float32)
    return Depths(offset, contrast, total, x, y, np.zeros_like(x))
