"""Floors of wide hollows and tops of wide rises.

What is wide fills the blocks that noise is told from, and hides its own middle: the edge alone is
found, in pieces. What it goes around is as deep, and belongs to it.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from roller_inspect.height_map.gaps import grown
from roller_inspect.height_map.height_map import Bools

from .cues import Cues, distance
from .finder_settings import FindingSettings
from .neighbourhood import ring_around

#: Floors are looked for within this distance of what was found, m.
_REACH_M = 12e-3
#: A floor is deeper than this share of what was found beside it, above the level around.
_SHARE, _DEPTH_PERCENT = 0.5, 90
#: Where what else was found on it is so many times as deep, it is that one's.
_TIMES = 1.3
#: Smaller ones are ragged edges, m².
_LEAST_M2 = 5e-7
#: So much of a floor's border lies within this distance, m, of what was found: it ends at walls.
#: That of a bent part doesn't.
_WALLED, _NEAR_M = 0.6, 3e-4


def with_floors(cues: Cues, step_m: float, settings: FindingSettings) -> Cues:
    """Cues that speak for floors too.

    Parameters
    ----------
    cues : Cues
        What speaks for findings.
    step_m : float
        Edge of a cell.
    settings : FindingSettings
        What counts as a finding.
    """
    known = cues.usable & np.isfinite(cues.fine_m)
    z, noise = cues.z, cues.noise_around_m
    for sign in (1, -1):
        weak = cues.weak & (np.sign(cues.z) == sign)
        own = known & ~(cues.weak & ~weak)
        depth = np.where(own, sign * cues.fine_m, -np.inf)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(weak.view(np.uint8))
        sure = cues.strong & weak & own
        depths = {}
        for number in np.unique(labels[sure]).tolist():
            box = _box(stats[number], 0)
            strong = sure[box] & (labels[box] == number)
            depths[number] = float(np.percentile(depth[box][strong], _DEPTH_PERCENT))
        # The deepest first: what only lies beside it doesn't take its floor.
        for number in sorted(depths, key=lambda n: -depths[n]):
            box = _box(stats[number], round(_REACH_M / step_m))
            mask = labels[box] == number
            floor = _floor(mask, weak[box], depths[number], depth[box], step_m)
            if floor is None:
                continue
            if z is cues.z:
                z, noise = z.copy(), noise.copy()
            new = floor & ~mask
            weak[box] |= new
            least = np.float32(1.01 * settings.strong_z)
            z[box] = np.where(new, sign * np.maximum(np.abs(z[box]), least), z[box])
            # It was the hollow's own depth.
            usual = cues.noise_m[:, None, None]
            here = noise[(slice(None), *box)]
            here[:] = np.where(floor, np.minimum(here, usual), here)
    if z is cues.z:
        return cues
    size = np.abs(z)
    strong = cues.strong | (size > settings.strong_z)
    weak = cues.weak | (size > settings.weak_z)
    return replace(cues, z=z, weak=weak, strong=strong, noise_around_m=noise)


def _box(stats: npt.NDArray[np.int32], reach: int) -> tuple[slice, slice]:
    """Window around a component."""
    x, y, width, height, _ = map(int, stats)
    return (
        slice(max(y - reach, 0), y + height + reach),
        slice(max(x - reach, 0), x + width + reach),
    )


def _floor(
    mask: Bools, found: Bools, found_m: float, depth: npt.NDArray[np.floating], step_m: float
) -> Bools | None:
    """What was found, with the floor beside it; None if there is none.

    Parameters
    ----------
    mask, found : ndarray of bool, shape (ny, nx)
        Cells of one component; of all.
    found_m : float
        How deep the one is.
    depth : ndarray, shape (ny, nx)
        Metres; minus infinity where it isn't known, or something else was found.
    """
    least = _LEAST_M2 / step_m**2
    ring, level = ring_around(mask, depth, step_m)
    limit = level + _SHARE * (found_m - level)
    if limit <= level or (ring > limit).sum() < least:
        return None
    deep = depth > limit
    _, labels = cv2.connectedComponents((deep | mask).view(np.uint8))
    floor = labels == labels[tuple(np.argwhere(mask)[0])]
    if (floor & deep & ~found).sum() < least:
        return None
    if np.percentile(depth[floor & found], _DEPTH_PERCENT) > _TIMES * found_m:
        return None
    # Where nothing is known it may go on.
    border = grown(floor, 1) & ~floor & np.isfinite(depth)
    near = distance(~found) * step_m <= _NEAR_M
    if not border.any() or near[border].mean() < _WALLED:
        return None
    return np.asarray(floor, bool)
