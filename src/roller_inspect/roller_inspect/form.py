"""What keeps a part from being conform and is no finding: its form, damage all over, gaps."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64, inverse_pose

from .findings.cues import disc, inspectable
from .findings.smoothing import cell_weights, smoothed
from .height_map import HeightMap
from .height_map.gaps import WIDE_GAP_M, inner_gaps
from .height_map.height_map import F32, Bools
from .judgement import judge_findings
from .measures import region_mask
from .pieces import Found
from .recipe import Recipe
from .recipe.tolerance import DEFAULT_TOLERANCE

#: Deviations are smoothed over this, m, to tell what lies off; most of an area that may.
_FORM_M, _MOST_OFF = 5e-4, 0.01
#: The same for a surface that is damaged all over. A wrong height is one that is off by so much, m:
#: what is allowed less can't be told from a scan's errors.
_ROUGH_M, _MOST_ROUGH, _WRONG_M = 1e-4, 0.03, 1e-4
#: The width of a gap's rim, m. So much of it, m², lies off by this share of what is allowed, and by
#: so much at least, m.
_RIM_M = 5e-4
_RIM_SHARE, _LEAST_RIM_M, _RIM_M2 = 0.5, 5e-5, 2.5e-7
#: Around a finding's outline its flanks go on, m.
_FLANK_M = 5e-4


def off_reference(recipe: Recipe, found: Found) -> str:
    """What share lies off the reference by more than is allowed there, in words.

    What is as wide as the scan stands out of nothing and is no finding. Of no meaning where the
    reference is the surface around.

    Parameters
    ----------
    recipe : Recipe
        Its area to inspect, and its tolerances, each where it holds.
    found : Found
        The whole.

    Returns
    -------
    str
        Empty: hardly any.
    """
    if recipe.reference.kind == "self":
        return ""
    share, most = _share_off(recipe, found, _FORM_M, sigmas=2.0)
    if share < _MOST_OFF:
        return ""
    return (
        f"{share:.0%} of the area lies more than {most} µm off the reference, too wide for "
        "a finding: the part's form differs, or the reference doesn't fit"
    )


def damaged_all_over(recipe: Recipe, found: Found) -> str:
    """What share lies deeper or higher than is allowed there and is no finding, in words.

    Findings stand out of the surface's own scatter; of one that is damaged all over the scatter is
    the damage.

    Parameters
    ----------
    recipe, found
        As of `off_reference`.

    Returns
    -------
    str
        Empty: little.
    """
    share, most = _share_off(recipe, found, _ROUGH_M, least_m=_WRONG_M)
    if share < _MOST_ROUGH:
        return ""
    return (
        f"{share:.0%} of the area lies more than {most} µm off its surroundings or reference, and "
        "nothing stands out of so much: the surface is rough or damaged all over"
    )


def goes_on_in_gap(recipe: Recipe, found: Found) -> str:
    """Which gap within what was measured may hide more than is allowed, in words.

    Nothing is looked for close to a gap, and what reaches into it is deeper there, or isn't.

    Parameters
    ----------
    recipe, found
        As of `off_reference`.

    Returns
    -------
    str
        Empty: none.
    """
    grid, deviation_m = found.height_map, found.deviation_m
    if grid is None or deviation_m is None:
        return ""
    gaps = inner_gaps(grid, WIDE_GAP_M)
    if not gaps.any():
        return ""
    rim = cv2.dilate(gaps.view(np.uint8), disc(_RIM_M / grid.step_m)) > 0
    rim &= grid.known & _to_inspect(recipe, grid)
    mean, _ = smoothed(deviation_m, cell_weights(grid, deviation_m), _ROUGH_M / grid.step_m)
    most = np.maximum(_RIM_SHARE * _allowed_depth(recipe, grid, mean), _LEAST_RIM_M)
    off = rim & (np.abs(np.where(np.isfinite(mean), mean, 0)) > most)
    _, labels, stats, centers = cv2.connectedComponentsWithStats(off.view(np.uint8))
    large = np.flatnonzero(stats[1:, cv2.CC_STAT_AREA] * grid.step_m**2 >= _RIM_M2) + 1
    if not len(large):
        return ""
    depths = [float(np.abs(mean[labels == k]).max()) for k in large]
    column, row = centers[large[int(np.argmax(depths))]]
    x, y = (axis[0] + at * grid.step_m for axis, at in ((grid.x_m, column), (grid.y_m, row)))
    x_mm, y_mm, _ = grid.in_base(x, y, 0.0) * 1e3
    return (
        f"beside a gap at ({x_mm:.1f}, {y_mm:.1f}) mm the surface lies {max(depths) * 1e6:.0f} µm "
        "off: how deep it goes on there wasn't measured"
    )


def _to_inspect(recipe: Recipe, grid: HeightMap) -> Bools:
    """Cells that the recipe doesn't leave out, shape (ny, nx)."""
    area = np.ones(grid.shape, bool)
    if recipe.inspect:
        area &= np.logical_or.reduce([region_mask(recipe, name, grid) for name in recipe.inspect])
    for name in recipe.exclude:
        area &= ~region_mask(recipe, name, grid)
    return area


def _share_off(
    recipe: Recipe, found: Found, scale_m: float, sigmas: float = 0.0, least_m: float = 0.0
) -> tuple[float, str]:
    """Share of the area that lies further off than is allowed and `sigmas`; the limits, in µm.

    Nothing is allowed less than `least_m`.
    """
    grid, deviation_m = found.height_map, found.deviation_m
    if grid is None or deviation_m is None:
        return 0.0, ""
    area = inspectable(grid, recipe.edge_exclusion_m) & _to_inspect(recipe, grid)
    mean, _ = smoothed(deviation_m, cell_weights(grid, deviation_m), scale_m / grid.step_m)
    area &= np.isfinite(mean)
    if not area.any():
        return 0.0, ""
    allowed = np.maximum(_allowed_depth(recipe, grid, mean), least_m)
    allowed = np.maximum(allowed, _granted(recipe, found, grid))
    off = area & (np.abs(mean) > allowed + sigmas * np.median(grid.sigma_m[area]))
    if not off.any():
        return 0.0, ""
    limits = np.unique(allowed[off]) * 1e6
    most = f"{limits[0]:g}" + (f" to {limits[-1]:g}" if len(limits) > 1 else "")
    return float(off.sum() / area.sum()), most


def _granted(recipe: Recipe, found: Found, grid: HeightMap) -> F64:
    """Depth that findings which conform may have, in their cells and close around, metres.

    One whose tolerance is of other sizes may have any; 0 elsewhere. Shape (ny, nx).
    """
    map_from_base = inverse_pose(grid.base_from_map)
    inside: dict[float, npt.NDArray[np.uint8]] = {}
    for one in judge_findings(recipe, found.findings):
        if one.verdict == "conform":
            corners = one.finding.outline_m @ map_from_base[:3, :3].T + map_from_base[:3, 3]
            cells = (corners[:, :2] - [grid.x_m[0], grid.y_m[0]]) / grid.step_m
            most = np.inf if one.depth_limit_m is None else one.depth_limit_m
            filled = inside.setdefault(most, np.zeros(grid.shape, np.uint8))
            cv2.fillPoly(filled, [np.rint(cells).astype(np.int32)], 1)
    out = np.zeros(grid.shape)
    for most, filled in sorted(inside.items()):
        out[cv2.dilate(filled, disc(_FLANK_M / grid.step_m)) > 0] = most
    return out


def _allowed_depth(recipe: Recipe, grid: HeightMap, mean_m: F32) -> F64:
    """What each cell may lie off, as it lies above or below, metres, shape (ny, nx)."""
    # A model has the part's own features: what differs from it is extra or missing.
    own = recipe.reference.kind in ("golden", "cad")
    above, below = ("extra", "missing") if own else ("raised", "dent")
    return np.where(mean_m > 0, _allowed(recipe, above, grid), _allowed(recipe, below, grid))


def _allowed(recipe: Recipe, kind: str, grid: HeightMap) -> F64:
    """Depth that a finding of a kind may have in each cell, metres, shape (ny, nx).

    Of the tolerances that limit depths the first that fits holds: one of lengths alone says
    nothing of a form.
    """
    assert DEFAULT_TOLERANCE.depth_m is not None
    out = np.full(grid.shape, DEFAULT_TOLERANCE.depth_m, np.float64)
    for entry in reversed(recipe.tolerances):
        if entry.depth_m is not None and entry.kind in ("any", kind):
            there = region_mask(recipe, entry.region, grid) if entry.region else True
            out = np.where(there, entry.depth_m, out)
    return np.asarray(out)
