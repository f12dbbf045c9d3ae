"""How much of the area that a recipe names was measured, compared and searched."""

from __future__ import annotations

import math

import numpy as np

from roller_core.transforms import F64, inverse_pose

from .findings.cues import inspectable
from .height_map import CONTINUED, OUTSIDE, UNMEASURED, HeightMap
from .height_map.coverage import Coverage, coverage_of_cells
from .height_map.height_map import F32, U8, Bools
from .measures import moved
from .pieces import Found
from .recipe import Recipe, Region

#: An area is looked at in so many places at most, and in so many along its shorter side at least.
_MOST_CELLS, _LEAST_PLACES = 4_000_000, 10
#: Share of what was measured that must be left by the edge exclusion.
_LEAST_SEARCHED = 0.25


def coverage_of_area(recipe: Recipe, found: Found) -> tuple[Coverage, tuple[str, ...]]:
    """Coverage of the area that a recipe names; what the scan didn't reach is unmeasured.

    What has no deviation, as the reference doesn't go so far, wasn't inspected and counts as
    unmeasured too.

    Parameters
    ----------
    recipe : Recipe
        Regions to inspect and to leave out, or with tolerances of their own.
    found : Found
        The whole.

    Returns
    -------
    Coverage
        Of all of it.
    tuple of str
        What else is lacking, one line each: regions of which too little was measured by
        themselves, a reference that ends before the scan, hardly anything that was searched.
    """
    height_map = found.height_map
    if height_map is None:
        return found.coverage, ()
    seen = _inspected_states(height_map, found.deviation_m)
    map_from_recipe = inverse_pose(height_map.base_from_map) @ recipe.base_from_recipe

    def kept(x: F64, y: F64) -> Bools:
        """Places that aren't left out."""
        out = np.ones(x.shape, bool)
        for name in recipe.exclude:
            out &= ~recipe.regions[name].contains(x, y)
        return out

    def covered(state: U8, step_m: float) -> Coverage:
        return coverage_of_cells(state, len(state) * step_m**2, found.coverage.points_per_mm2)

    def within(*names: str) -> Coverage:
        """Of regions with all that the scan didn't reach."""
        regions = [recipe.regions[name] for name in names]
        x, y, fine = _places(regions, height_map.step_m)
        inside = np.logical_or.reduce([each.contains(x, y) for each in regions]) & kept(x, y)
        at = moved(map_from_recipe, x[inside], y[inside])
        return covered(_states_at(height_map, seen, *at), fine)

    if recipe.inspect:
        whole = within(*recipe.inspect)
    else:
        grid = np.meshgrid(height_map.x_m, height_map.y_m)
        inside = kept(*moved(inverse_pose(map_from_recipe), *grid)) & (seen != OUTSIDE)
        whole = covered(seen[inside], height_map.step_m)
    lacking = []
    own = {t.region for t in recipe.tolerances if t.region} | set(recipe.inspect)
    for name in own - set(recipe.exclude):
        part = within(name)
        if not part.area_m2 or enough(recipe, part):
            continue
        if part.scanned:
            lacking.append(f"{1 - part.unmeasured:.1%} of region '{name}' was measured")
        else:
            lacking.append(f"the scan reached nothing of region '{name}'")
    known = int(height_map.known.sum())
    searched = int(inspectable(height_map, recipe.edge_exclusion_m).sum())
    compared = int((seen >= CONTINUED).sum())
    if compared < known and not enough(recipe, whole):
        lacking.append(f"the reference goes over {compared / known:.1%} of what was measured")
    if searched < _LEAST_SEARCHED * known:
        edge_mm = recipe.edge_exclusion_m * 1e3
        lacking.append(
            f"{searched / known:.1%} of it was searched: edges of {edge_mm:g} mm left out"
        )
    return whole, tuple(sorted(lacking))


def enough(recipe: Recipe, coverage: Coverage) -> bool:
    """Whether the least coverage was reached."""
    return coverage.area_m2 > 0 and coverage.unmeasured <= 1 - recipe.least_coverage + 1e-9


def _inspected_states(height_map: HeightMap, deviation_m: F32 | None) -> U8:
    """States of cells; those that were compared with nothing are unmeasured."""
    if deviation_m is None or not np.isfinite(deviation_m).any():
        return height_map.state
    bare = height_map.known & ~np.isfinite(deviation_m)
    return np.where(bare, np.uint8(UNMEASURED), height_map.state)


def _places(regions: list[Region], step_m: float) -> tuple[F64, F64, float]:
    """Places over all of some regions, which may reach beyond the map, and their spacing."""
    corners = np.concatenate([region.outline() for region in regions])
    low, high = corners.min(axis=0), corners.max(axis=0)
    fine = min(step_m, float((high - low).min()) / _LEAST_PLACES)
    fine = max(fine, math.sqrt(float(np.prod(high - low)) / _MOST_CELLS))
    axes = zip(low, high, strict=True)
    x, y = np.meshgrid(*(np.arange(low + fine / 2, high, fine) for low, high in axes))
    return x, y, fine


def _states_at(height_map: HeightMap, seen: U8, x: F64, y: F64) -> U8:
    """States of the cells of a map that places lie in; beyond it they are outside."""
    column = np.rint((x - height_map.x_m[0]) / height_map.step_m).astype(np.int64)
    row = np.rint((y - height_map.y_m[0]) / height_map.step_m).astype(np.int64)
    there = (row >= 0) & (row < height_map.shape[0])
    there &= (column >= 0) & (column < height_map.shape[1])
    state = np.full(x.shape, OUTSIDE, np.uint8)
    state[there] = seen[row[there], column[there]]
    return state
