"""The figures that a recipe names, by the measuring tools."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roller_core.transforms import F64, inverse_pose

from .findings import CellUncertainty
from .height_map.height_map import Bools, HeightMap
from .measuring.measured import Measured
from .measuring.profile import profile, width_and_depth
from .measuring.regions import extent, flushness_and_tilt, roughness, step_height
from .recipe import Recipe, decide
from .recipe.decision import Verdict
from .recipe.measure import Measure

#: How often the scale's uncertainty counts, by unit; slopes know none.
_POWERS = {"m": 1, "m²": 2, "m³": 3, "rad": 0}


@dataclass(frozen=True)
class Figure:
    """A figure and what the recipe says of it."""

    #: As the recipe has them.
    name: str
    tool: str
    of: str
    datum: str
    #: In `unit`; None where it can't be measured.
    value: float | None
    #: Expanded, k = 2, in `unit`.
    uncertainty: float
    #: m, m², m³ or rad.
    unit: str
    #: The recipe's limits.
    low: float | None
    high: float | None
    #: ``conform`` too for a figure without limits.
    verdict: Verdict
    #: Why there is no value.
    reason: str


def measure_all(
    recipe: Recipe, height_map: HeightMap | None, cell: CellUncertainty
) -> tuple[Figure, ...]:
    """All figures that a recipe names; unmeasured ones without a map."""
    return tuple(_figure(recipe, entry, height_map, cell) for entry in recipe.measures)


def _figure(
    recipe: Recipe, entry: Measure, height_map: HeightMap | None, cell: CellUncertainty
) -> Figure:
    if height_map is None:
        found = Measured(None, math.nan, "m", "nothing was measured")
    else:
        found = _measured(recipe, entry, height_map)
    limits = (entry.low, entry.high)
    low, high = (s * math.inf if v is None else v for s, v in zip((-1, 1), limits, strict=True))
    value = math.nan if found.value is None else found.value
    # Of an area twice, of a volume three times.
    scale = 2 * cell.values[1] * _POWERS[found.unit] * value
    uncertainty = math.hypot(found.uncertainty, scale)
    verdict: Verdict = "conform"
    if limits != (None, None):
        verdict = decide(value, uncertainty, low, high, recipe.decision)
    return Figure(
        entry.name, entry.tool, entry.of, entry.datum, found.value, uncertainty, found.unit,
        entry.low, entry.high, verdict, found.reason,
    )  # fmt: skip


def _measured(recipe: Recipe, entry: Measure, height_map: HeightMap) -> Measured:
    if entry.of in recipe.lines:
        map_from_recipe = inverse_pose(height_map.base_from_map) @ recipe.base_from_recipe
        ends = np.array([[*end, 0.0, 1.0] for end in recipe.lines[entry.of]])
        start, end = (tuple(place[:2].tolist()) for place in ends @ map_from_recipe.T)
        width, depth = width_and_depth(profile(height_map, start, end))
        return width if entry.tool == "width" else depth
    region = region_mask(recipe, entry.of, height_map)
    whole = _cells(recipe, entry.of, height_map, region)
    if entry.tool.startswith("roughness"):
        return roughness(height_map, region, whole)[entry.tool == "roughness_sq"]
    datum = region_mask(recipe, entry.datum, height_map) & ~region
    if entry.tool == "step_height":
        return step_height(height_map, datum, region, whole)
    if entry.tool in ("flushness", "tilt"):
        return flushness_and_tilt(height_map, region, datum, whole)[entry.tool == "tilt"]
    return extent(height_map, region, datum, whole)[entry.tool]


def _cells(recipe: Recipe, name: str, height_map: HeightMap, region: Bools) -> float:
    """Cells of a region of the recipe, with those beyond the map; `region`: those of the map."""
    map_from_recipe = inverse_pose(height_map.base_from_map) @ recipe.base_from_recipe
    corners = recipe.regions[name].outline()
    there = zip(moved(map_from_recipe, *corners.T), (height_map.x_m, height_map.y_m), strict=True)
    half, on_map = height_map.step_m / 2, float(region.sum())
    if all(at.min() >= axis[0] - half and at.max() <= axis[-1] + half for at, axis in there):
        return on_map
    return max(on_map, recipe.regions[name].area_m2 / height_map.step_m**2)


def region_mask(recipe: Recipe, name: str, height_map: HeightMap) -> Bools:
    """Cells of a map that lie in a region of the recipe, shape (ny, nx)."""
    recipe_from_map = inverse_pose(recipe.base_from_recipe) @ height_map.base_from_map
    x, y = np.meshgrid(height_map.x_m, height_map.y_m)
    return recipe.regions[name].contains(*moved(recipe_from_map, x, y))


def moved(pose: F64, x: F64, y: F64) -> tuple[F64, F64]:
    """Places of a plane in another frame, by the pose (4, 4) of their own in that."""
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 3],
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 3],
    )
