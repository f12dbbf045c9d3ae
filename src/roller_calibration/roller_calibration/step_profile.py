"""The profile of equal steps in a cloud of points: its walls, as lines show them, and levels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from .pass_lines import WALL_SLOPE, PassLines
from .printed_steps import find_printed_steps
from .step_walls import LEAST_WALLS, find_walls, nearest_wall, step_height, steps_apart, wall_levels

#: So near to a wall of steps any height of it is right, m; and so far along the roll a step is
#: looked for.
_ON_WALL_M, _NEAR_WALL_M = 1.5e-4, 5e-4
#: What is found as a wall whose height is off by so many steps from what its number says is none.
_OFF = 0.3


@dataclass(frozen=True)
class StepProfile:
    """Equal steps, and points beside their walls; m of n points."""

    #: Number of walls, and a step's height as measured, metres; NaN if the walls don't tell it.
    count: int
    fitted_m: float
    #: How many steps most walls lie above the one before: one, or steps are higher than thought.
    apart: int
    #: How many more walls are as high as their number says than are not.
    fits: float
    #: Which points lie near walls, shape (n,), and the number of their wall, shape (m,).
    near: npt.NDArray[np.bool_]
    nearest: npt.NDArray[np.int64]
    #: Which of them lie on it, whatever their height; shape (m,).
    on: npt.NDArray[np.bool_]
    #: How far points lie from the profile, metres, shape (m,).
    error_m: F64


def find_profile(found: PassLines, points: F64, step_m: float) -> StepProfile | None:
    """The profile by the walls that fit the points' heights best; None without walls.

    All lines on slopes together, or those of one polarity: where the polarities lie far apart, as
    on walls that the skin rounds off, what one shows of a wall may pass for a wall of its own, and
    shift the number of all behind it.

    Parameters
    ----------
    found : PassLines
        Lines of a pass.
    points : ndarray of float64, shape (n, 3)
        The cloud, in the frame of the lines, metres.
    step_m : float
        Height of a step.
    """
    steep = np.abs(found.lines.slope) > WALL_SLOPE
    best: StepProfile | None = None
    for which in (steep, *(steep & (found.lines.polarity == k) for k in (0, 1))):
        own = _of_lines(found, which, points, step_m) if which.any() else None
        if own is not None and (best is None or own.fits > best.fits):
            best = own
    return best


def printed_profile(places: F64, sigma_m: F64, points: F64, step_m: float) -> StepProfile | None:
    """The same under a printed skin, by the profile of the depths of neighbourhoods.

    See `find_printed_steps`.
    """
    steps = find_printed_steps(places, sigma_m, step_m)
    if steps is None or len(steps.at_m) < LEAST_WALLS:
        return None
    across, on = steps.places(points)
    profile = _of_walls(across, on, points[:, 2], steps.at_m, steps.change, step_m)
    return replace(profile, fitted_m=steps.step_m)


def _of_lines(
    found: PassLines, which: npt.NDArray[np.bool_], points: F64, step_m: float
) -> StepProfile | None:
    """The profile by the walls that some of the lines show."""
    x, y, _ = found.place[which].T
    slope = found.lines.slope[which]
    wall, count, across = find_walls(x, y, slope, found.lines.sigma_m[which], step_m)
    if count < LEAST_WALLS:
        return None
    at = np.array([np.median(across[wall == k]) for k in range(count)])
    change = np.sign([np.median(slope[wall == k]) for k in range(count)])
    # The walls' own axes: how `across` goes with x and y.
    turn = np.linalg.lstsq(np.column_stack([x, y, np.ones_like(x)]), across, rcond=None)[0]
    u = points[:, :2] @ turn[:2] + turn[2]
    return _of_walls(u, np.ones(len(u), np.bool_), points[:, 2], at, change, step_m)


def _of_walls(
    across: F64, of_steps: npt.NDArray[np.bool_], height: F64, at: F64, change: F64, step_m: float
) -> StepProfile:
    """The profile of walls at places across them, and how points of the steps fit it."""
    count = len(at)
    nearest, off = nearest_wall(across, at)
    near = of_steps & (np.abs(off) < _NEAR_WALL_M)
    height, nearest, off = height[near], nearest[near], off[near]
    on = np.abs(off) < _ON_WALL_M
    levels = np.array(
        [
            np.median(own) if len(own := height[on & (nearest == k)]) else np.nan
            for k in range(count)
        ]
    )
    middle = wall_levels(levels / step_m, change)
    kind = (change[nearest] < 0).astype(np.int64)
    fitted_m = step_height(np.where(on, nearest, -1), kind, height, middle)
    over = height - step_m * middle[nearest]
    over -= np.median(over[on]) if on.any() else 0.0
    half = 0.5 * step_m
    tread = half * change[nearest] * np.sign(off)
    error = np.where(on, np.maximum(np.abs(over) - half, 0.0), np.abs(over - tread))
    fits = _fitting(levels / step_m - middle, change)
    apart = steps_apart(middle, change)
    return StepProfile(count, fitted_m, apart, fits, near, nearest, on, error)


def _fitting(off: F64, change: F64) -> float:
    """How many more walls are as high as their number says than are not.

    Parameters
    ----------
    off : ndarray of float64, shape (n,)
        Height less what the number says, in steps; NaN where a wall has no height. What walls that
        rise have in common, or those that fall, is drift.
    change : ndarray of float64, shape (n,)
        See `wall_levels`.
    """
    fits, seen = 0.0, np.isfinite(off)
    for kind in np.unique(change[seen]):
        own = off[seen & (change == kind)]
        rest = (own - np.median(own)) / _OFF
        fits += float(np.sum(1.0 - 2.0 * np.minimum(rest**2, 1.0)))
    return fits
