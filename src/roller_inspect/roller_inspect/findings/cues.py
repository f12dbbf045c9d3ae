"""What speaks for a finding, cell by cell.

The height's deviation at several scales; and where little is seen, so that heights can't be
smoothed, that edges are dense there and lie off the reference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from roller_inspect.height_map.height_map import F32, MEASURED, OUTSIDE, Bools, HeightMap
from roller_inspect.height_map.medians import block_medians, median_around, spread_blocks
from roller_inspect.references.background import SelfReference
from roller_inspect.references.reference import Comparison

from .dense_edges import DENSE_SHARE, dense_edges
from .finder_settings import FindingSettings
from .smoothing import (
    between_blocks,
    block_means,
    cell_weights,
    smoothed,
    smoothed_sums,
    weighted,
)

#: Standard deviations of the Gaussians, m.
SCALES_M = (1e-4, 2e-4, 5e-4, 1e-3)
#: What is smoothed needs no cells finer than this part of its Gaussian's standard deviation.
_GRAIN = 0.4
#: A smoothed height needs the weight of so many measured cells, in part of its Gaussian.
_LEAST_SHARE = 0.05
#: Noise at every scale is at least this, m: what no test resolved.
_LEAST_SIGMA_M = 2e-6
#: Noise is taken from blocks of this size, m, where so many of nine have some.
_BLOCK_M, _LEAST_BLOCKS = 4e-3, 4
#: What points claim is smoothed by a Gaussian of this standard deviation, m.
_CLAIM_M = 2e-3
#: Peaks of chance that may pass for findings at one scale, 1/m², and fewest to tell from.
_FALSE_PER_M2, _LEAST_PEAKS = 300.0, 30
#: Beyond the quartiles the tail is longer still; tuned on the virtual cell, checked on another
#: simulator.
_LONGER = 1.2
#: What a scale found is no news to coarser ones, nor what lies so near to it, m.
_FOUND_M = 3e-4
#: Gaps in what shows all of the surface, m, and its smallest part, m².
_GAP_M, _LEAST_AREA_M2 = 5e-4, 1e-5


@dataclass(frozen=True)
class Cues:
    """What speaks for a finding."""

    #: Signed deviation in its standard uncertainty, of the scale where it is largest; 0 where
    #: nothing is known. Shape (ny, nx).
    z: F32
    #: Cells that may belong to a finding, and that make one. Shape (ny, nx).
    weak: Bools
    strong: Bools
    #: Standard uncertainty of heights smoothed by the finest and the coarsest scale, as the scan
    #: itself shows it: usual values, and around each cell. Shapes (2,) and (2, ny, nx).
    noise_m: F32
    noise_around_m: F32
    #: Cells that dense edges speak for. Shape (ny, nx).
    edges: Bools
    #: Of cells, for smoothing; and the deviation smoothed by the finest scale, NaN where nothing is
    #: known. Shapes (ny, nx).
    weight: F32
    fine_m: F32
    #: Area of known cells that a point stands for as a rule, m²; 0 where there is none.
    point_area_m2: float
    #: Where findings are looked for, and what lies beyond the border of that, without inner gaps.
    #: Shapes (ny, nx).
    usable: Bools
    outer: Bools


def height_cue(
    height_map: HeightMap, comparison: Comparison, settings: FindingSettings, local: bool = True
) -> Cues:
    """Cells whose smoothed height differs from the reference by more than chance.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    comparison : Comparison
        The same map against its reference.
    settings : FindingSettings
        What counts as a finding.
    local : bool
        Whether the deviation from its own surroundings counts too: what is left of the form, and
        slow errors of the scan, hide small findings in the deviation itself.
    """
    step = height_map.step_m
    usable = inspectable(height_map, settings.edge_exclusion_m)
    best = np.zeros(height_map.shape, np.float32)
    usual = np.zeros(2, np.float32)
    around = np.zeros((2, *height_map.shape), np.float32)
    claimed, reference = _claimed(height_map), comparison.sigma_m
    whole = comparison.deviation_m
    fields, weights, fine = [whole], [cell_weights(height_map, whole)], whole
    if local:
        fields.append(detail(height_map, whole))
        weights.append(cell_weights(height_map, fields[1]))
    for field, weight in zip(fields, weights, strict=True):
        found = np.zeros(height_map.shape, bool)
        filled = weighted(field, weight)
        for k, scale in enumerate(SCALES_M):
            by = _grain(scale / step)
            cells = (slice(None, None, by), slice(None, None, by))
            sums, weights_left = (block_means(np.where(found, 0, v), by) for v in (filled, weight))
            mean, share = smoothed_sums(sums, weights_left, max(scale / step / by, 0.5))
            if field is whole and k == 0:
                fine = mean if by == 1 else between_blocks(mean, by, height_map.shape)
            counts = usable[cells] & ~found[cells] & (share > _LEAST_SHARE)
            noise = _noise(mean, counts & (weights_left > 0), claimed[cells], step * by)
            thinned = noise[::2, ::2][counts[::2, ::2]]
            if k in (0, len(SCALES_M) - 1) and len(thinned):
                end = int(k > 0)
                usual[end] = np.median(thinned)
                around[end] = spread_blocks(noise, by, height_map.shape)
            doubt = reference[cells]
            if comparison.of_walls:
                spread = block_means(np.where(found, 0, weight * reference), by)
                away, _ = smoothed_sums(spread, weights_left, max(scale / step / by, 0.5))
                doubt = np.fmax(doubt, away)
            with np.errstate(invalid="ignore"):
                z = np.asarray(mean / np.hypot(noise, doubt), np.float32)
            z[~counts] = 0
            tail = _tail(z, counts, scale / step / by, step * by)
            z *= np.float32(settings.strong_z / max(tail, settings.strong_z))
            z = between_blocks(z, by, height_map.shape)
            z[~usable | found] = 0
            size = np.abs(z)
            np.copyto(best, z, where=size > np.abs(best))
            sure = connected(size > settings.weak_z, size > settings.strong_z)
            found |= cv2.dilate(sure.view(np.uint8), disc(_FOUND_M / step)).view(bool)
    # The background goes along with what alone is seen; the few points around tell more.
    itself = comparison.alignment.reference == "self"
    heights = height_map.height_m if itself else comparison.deviation_m
    sign = dense_edges(height_map, heights, usable)
    edges = sign != 0
    best = np.where(edges, sign * np.maximum(best * sign, np.float32(settings.strong_z)), best)
    size = np.abs(best)
    strong = (size > settings.strong_z) | edges
    per_point = _area_of_a_point(height_map)
    weak = size > settings.weak_z
    outer = _outer(usable & (height_map.state != OUTSIDE))
    return Cues(
        best, weak, strong, usual, around, edges, weights[0], fine, per_point, usable, outer,
    )  # fmt: skip


def _grain(scale_cells: float) -> int:
    """How much coarser, a power of two, the cells may be for a Gaussian of so many cells."""
    return 2 ** max(0, int(np.floor(np.log2(scale_cells * _GRAIN))))


def _area_of_a_point(height_map: HeightMap) -> float:
    """Area of known cells that a point stands for as a rule, m²; 0 where there is none."""
    known = height_map.known
    points = int(height_map.points[known].sum())
    return float(known.sum()) * height_map.step_m**2 / points if points else 0.0


def connected(weak: Bools, strong: Bools) -> Bools:
    """Weak cells that hang together with a strong one, corners included."""
    out = np.zeros(weak.shape, bool)
    if (both := weak & strong).any():
        count, labels = cv2.connectedComponents(weak.astype(np.uint8))
        sure = np.zeros(count, bool)
        sure[labels[both]] = True
        out[weak] = sure[labels[weak]]
    return out


def disc(reach_cells: float) -> npt.NDArray[np.uint8]:
    """Cells within a distance of the middle one, for `cv2.dilate`."""
    k = int(reach_cells)
    away = np.hypot(*np.mgrid[-k : k + 1, -k : k + 1])
    return (away <= reach_cells).astype(np.uint8)


def distance(cells: Bools) -> npt.NDArray[np.float64]:
    """Distance of each of some cells to the nearest other one, in cells."""
    away = cv2.distanceTransform(cells.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.sqrt(np.rint(np.square(away, dtype=np.float64)))


def _tail(z: npt.NDArray[np.floating], usable: Bools, scale: float, step_m: float) -> float:
    """Size that peaks of chance reach `_FALSE_PER_M2` times a square metre.

    Errors of a scan have longer tails than normal ones. Squares of their peaks' sizes fall off as
    an exponential; its slope is taken between the quartiles, which the few peaks of findings don't
    move.
    """
    size = np.abs(z)
    reach = 2 * max(1, round(scale)) + 1
    highest = cv2.dilate(size, np.ones((reach, reach), np.uint8))
    peaks = size[(size == highest) & usable & (size > 0)]
    if len(peaks) < _LEAST_PEAKS:
        return 0.0
    middle, high = np.percentile(peaks, [50, 75]) ** 2
    fall = float(high - middle) / np.log(2.0)
    wanted = _FALSE_PER_M2 * float(usable.sum()) * step_m**2
    return _LONGER * float(np.sqrt(middle + fall * max(np.log(0.5 * len(peaks) / wanted), 0.0)))


def detail(height_map: HeightMap, deviation_m: F32) -> F32:
    """A deviation less its own surroundings, robustly."""
    return SelfReference().compare(replace(height_map, height_m=deviation_m)).deviation_m


def inspectable(height_map: HeightMap, edge_m: float) -> Bools:
    """Where findings are looked for: known cells, away from the border of what was measured.

    Where most was measured, islands in what wasn't are left out: they are remains of what had no
    contact or too little view.
    """
    step, inside = height_map.step_m, height_map.state != OUTSIDE
    if not inside.any():
        return inside
    area = inside
    if height_map.known[inside].mean() > DENSE_SHARE:
        # What is close together; gaps as wide as findings belong to it.
        k = max(1, round(_GAP_M / step))
        ones = np.ones((2 * k + 1, 2 * k + 1), np.uint8)
        # Beyond the map nothing is known: OpenCV would close up to its end.
        known = np.pad(height_map.known.view(np.uint8), k)
        close = cv2.morphologyEx(known, cv2.MORPH_CLOSE, ones)[k:-k, k:-k]
        close = cv2.morphologyEx(close, cv2.MORPH_OPEN, ones)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(close, connectivity=4)
        large = stats[:, cv2.CC_STAT_AREA] * step**2 >= _LEAST_AREA_M2
        large[0] = False
        area = large[labels]
    away = cv2.distanceTransform(np.pad(area, 1).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # Squares of distances are whole numbers of cells.
    return away[1:-1, 1:-1] > np.sqrt(np.floor(np.square(edge_m / step) + 1e-9) + 0.5)


def _outer(usable: Bools) -> Bools:
    """What lies beyond the border of what is searched, but for gaps in it."""
    _, labels = cv2.connectedComponents(np.pad(~usable, 1, constant_values=True).view(np.uint8))
    return np.asarray(labels[1:-1, 1:-1] == labels[0, 0], bool)


def _claimed(height_map: HeightMap) -> F32:
    """Uncertainty that points claim around each place, of what they usually claim.

    It grows towards the ends of a scan, where surface was seen through less travel, within less
    than the blocks that noise is taken from.
    """
    sigma, state = height_map.sigma_m[::2, ::2], height_map.state[::2, ::2]
    measured = (state == MEASURED) & np.isfinite(sigma) & (sigma > 0)
    if not measured.any():
        return np.ones(height_map.shape, np.float32)
    around, _ = smoothed(sigma, measured.astype(np.float32), _CLAIM_M / height_map.step_m / 2)
    share = around / np.median(around[measured])
    share = np.where(np.isfinite(share), share, np.float32(1))
    return spread_blocks(share, 2, height_map.shape)


def _noise(mean: F32, usable: Bools, claimed: F32, step_m: float) -> F32:
    """Robust spread of a smoothed deviation around each place, as points there claim it.

    The median of nine blocks, so that a finding, which fills one or two, doesn't hide itself; and
    never far below the whole's.
    """
    if not usable.any():
        return np.full(mean.shape, np.inf, np.float32)
    # Every other cell says as much: errors of neighbours are alike.
    m = max(1, round(_BLOCK_M / step_m / 2))
    size, counts = np.abs(mean[::2, ::2] / claimed[::2, ::2]), usable[::2, ::2]
    whole = 1.4826 * float(np.median(size[counts])) if counts.any() else 0.0
    blocks = block_medians(size, counts, m, m / 2)
    around = 1.4826 * median_around(blocks, _LEAST_BLOCKS)
    spread = np.maximum(np.where(np.isfinite(around), around, whole), 0.4 * whole)
    noise = claimed * spread_blocks(spread.astype(np.float32), 2 * m, mean.shape)
    return np.maximum(noise, np.float32(_LEAST_SIGMA_M))
