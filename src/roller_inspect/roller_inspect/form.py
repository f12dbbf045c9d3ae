"""Whether a part has its reference's form: what is as wide as the scan stands out of nothing."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64

from .findings.cues import inspectable
from .findings.smoothing import cell_weights, smoothed
from .height_map import HeightMap
from .measures import region_mask
from .pieces import Found
from .recipe import Recipe
from .recipe.tolerance import DEFAULT_TOLERANCE

#: Deviations are smoothed over this, m, to tell what lies off; most of an area that may.
_FORM_M, _MOST_OFF = 5e-4, 0.01


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
    grid, deviation_m = found.height_map, found.deviation_m
    if grid is None or deviation_m is None or recipe.reference.kind == "self":
        return ""
    area = inspectable(grid, recipe.edge_exclusion_m)
    if recipe.inspect:
        area &= np.logical_or.reduce([region_mask(recipe, name, grid) for name in recipe.inspect])
    for name in recipe.exclude:
        area &= ~region_mask(recipe, name, grid)
    mean, _ = smoothed(deviation_m, cell_weights(grid, deviation_m), _FORM_M / grid.step_m)
    area &= np.isfinite(mean)
    if not area.any():
        return ""
    # A model has the part's own features: what differs from it is extra or missing.
    own = recipe.reference.kind in ("golden", "cad")
    above, below = ("extra", "missing") if own else ("raised", "dent")
    allowed = np.where(mean > 0, _allowed(recipe, above, grid), _allowed(recipe, below, grid))
    off = area & (np.abs(mean) > allowed + 2 * np.median(grid.sigma_m[area]))
    share = float(off.sum() / area.sum())
    if share < _MOST_OFF:
        return ""
    limits = np.unique(allowed[off]) * 1e6
    most = f"{limits[0]:g}" + (f" to {limits[-1]:g}" if len(limits) > 1 else "")
    return (
        f"{share:.0%} of the area lies more than {most} µm off the reference, too wide for "
        "a finding: the part's form differs, or the reference doesn't fit"
    )


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
