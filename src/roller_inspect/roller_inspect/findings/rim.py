"""The raised rim that tells a crater from a dent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_inspect.height_map.height_map import F32, Bools

from .cues import distance

#: A hollow is a crater if around it, in rings so wide and up to so far, m, the surface rises by
#: more than this part of its depth and of the noise. Tuned on the virtual cell.
_RIM, _RIM_NOISE, _RIM_STEP_M, _RIM_M = 0.03, 1 / 3, 2e-4, 1.2e-3
#: No rim is told where less than this share is known.
_RIM_KNOWN = 0.5
#: Beyond, up to here, m, lies what the rim rises above.
BEYOND_RIM_M = 1.8e-3


@dataclass(frozen=True)
class Rim:
    """How the surface rises around a hollow, metres."""

    #: By how much, and above which level.
    height: float
    level: float
    #: Up to how far from the hollow.
    reach: float


def rim_around(
    height: F32, shape: Bools, usable: Bools, step: float, depth: float, noise: float
) -> Rim | None:
    """The rim of a hollow; None where nothing rises beyond the noise.

    By medians of rings: a rise on one side alone is none of a rim.

    Parameters
    ----------
    height : ndarray of float32, shape (ny, nx)
        Metres.
    shape, usable : ndarray of bool, shape (ny, nx)
        Cells of the hollow; cells that may be of its rim.
    step, depth, noise : float
        Spacing of cells, depth of the hollow, noise of heights, metres.
    """
    rim = _highest(height, shape, usable, step)
    return None if rim.height <= _RIM * depth + _RIM_NOISE * noise else rim


def _highest(height: F32, shape: Bools, usable: Bools, step: float) -> Rim:
    away = distance(~shape) * step
    beyond = usable & (away > _RIM_M) & (away <= BEYOND_RIM_M)
    if not beyond.any() or usable[away <= BEYOND_RIM_M].mean() < _RIM_KNOWN:
        return Rim(0.0, 0.0, 0.0)
    level = float(np.median(height[beyond]))
    ends = np.arange(_RIM_STEP_M, _RIM_M + 1e-9, _RIM_STEP_M)
    rings = [usable & (away > end - _RIM_STEP_M) & (away <= end) for end in ends]
    rises = np.array([np.median(height[r]) - level if r.any() else -np.inf for r in rings])
    top = int(np.argmax(rises))
    low = np.flatnonzero(rises[top:] < 0.5 * rises[top])
    last = top + int(low[0]) - 1 if len(low) else len(ends) - 1
    return Rim(float(rises[top]), level, float(ends[last]))
