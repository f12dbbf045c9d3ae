"""How much of the area that a recipe names was measured, compared and searched."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64, inverse_pose

from .findings.cues import inspectable
from .height_map import CONTINUED, OUTSIDE, HeightMap
from .height_map.coverage import Coverage, counts_of, coverage_of_counts
from .height_map.height_map import F32, Bools
from .height_map.shares import inspected_states, measured_cells
from .measures import moved
from .pieces import Found
from .recipe import Recipe, Region

I64 = npt.NDArray[np.int64]
#: Cells of a map, by their rows and columns or by a mask.
Cells = tuple[I64, I64] | Bools
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
    seen = inspected_states(height_map, found.deviation_m)
    shares = _inspected_shares(found)
    map_from_recipe = inverse_pose(height_map.base_from_map) @ recipe.base_from_recipe

    def kept(x: F64, y: F64) -> Bools:
        """Places that aren't left out."""
        out = np.ones(x.shape, bool)
        for name in recipe.exclude:
            out &= ~recipe.regions[name].contains(x, y)
        return out

    def covered(where: Cells, step_m: float, beyond: float | None = None) -> Coverage:
        """Of some cells of the map; `beyond`: as many as the scan didn't reach, if that counts."""
        counts = counts_of(seen[where], _at(shares, where))
        measured = measured_cells(height_map.state[where], _at(found.shares, where))
        counts[OUTSIDE] = 0.0 if beyond is None else counts[OUTSIDE] + beyond
        cover = coverage_of_counts(counts, step_m**2, found.coverage.points_per_mm2)
        return replace(cover, seen=measured / max(float(counts.sum()), 1.0))

    def within(*names: str) -> Coverage:
        """Of regions with all that the scan didn't reach."""
        regions = [recipe.regions[name] for name in names]
        # A region's border needs the finer cells that a coarse map is made of.
        x, y, fine = _places(regions, height_map.step_m if shares is None else recipe.grid_m)
        inside = np.logical_or.reduce([each.contains(x, y) for each in regions]) & kept(x, y)
        row, column = _cells_at(height_map, *moved(map_from_recipe, x[inside], y[inside]))
        return covered((row, column), fine, float(inside.sum() - len(row)))

    if recipe.inspect:
        whole = within(*recipe.inspect)
    else:
        grid = np.meshgrid(height_map.x_m, height_map.y_m)
        inside = kept(*moved(inverse_pose(map_from_recipe), *grid))
        whole = covered(inside, height_map.step_m)
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


def _inspected_shares(found: Found) -> F32 | None:
    """Shares of cells; what was compared with nothing is unmeasured, as in `inspected_states`."""
    shares, deviation_m = found.shares, found.deviation_m
    if shares is None or found.height_map is None or deviation_m is None:
        return shares
    if not np.isfinite(deviation_m).any():
        return shares
    bare = (found.height_map.state != OUTSIDE) & ~np.isfinite(deviation_m)
    nothing = np.stack([shares.sum(axis=0), *np.zeros_like(shares[1:])])
    return np.where(bare, nothing, shares)


def _at(shares: F32 | None, where: Cells) -> F32 | None:
    """Shares of some cells, shape (4, n)."""
    if shares is None:
        return None
    return shares[:, where] if isinstance(where, np.ndarray) else shares[:, where[0], where[1]]


def _places(regions: list[Region], step_m: float) -> tuple[F64, F64, float]:
    """Places over all of some regions, which may reach beyond the map, and their spacing."""
    corners = np.concatenate([region.outline() for region in regions])
    low, high = corners.min(axis=0), corners.max(axis=0)
    fine = min(step_m, float((high - low).min()) / _LEAST_PLACES)
    fine = max(fine, math.sqrt(float(np.prod(high - low)) / _MOST_CELLS))
    axes = zip(low, high, strict=True)
    x, y = np.meshgrid(*(np.arange(low + fine / 2, high, fine) for low, high in axes))
    return x, y, fine


def _cells_at(height_map: HeightMap, x: F64, y: F64) -> tuple[I64, I64]:
    """Rows and columns of the cells that places lie in, of those that lie on the map."""
    column = np.rint((x - height_map.x_m[0]) / height_map.step_m).astype(np.int64)
    row = np.rint((y - height_map.y_m[0]) / height_map.step_m).astype(np.int64)
    there = (row >= 0) & (row < height_map.shape[0])
    there &= (column >= 0) & (column < height_map.shape[1])
    return row[there], column[there]
