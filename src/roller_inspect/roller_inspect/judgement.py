"""From what was found on a part to its verdict, by its recipe."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from roller_core.seq_gaps import MOST_MISSING
from roller_core.transforms import inverse_pose

from .findings import CellUncertainty, Finding
from .height_map import OUTSIDE, HeightMap
from .height_map.coverage import Coverage, coverage_of_cells, textured
from .measures import Figure, measure_all, moved
from .pieces import Found
from .recipe import Recipe, decide, part_verdict
from .recipe.decision import Verdict

_UNITS = {"m": ("mm", 1e3), "m2": ("mm²", 1e6), "m3": ("mm³", 1e9)}
#: An area to inspect is looked at in so many places at most.
_MOST_CELLS = 4_000_000


@dataclass(frozen=True)
class Judged:
    """A finding and what the recipe says of it."""

    #: What was found.
    finding: Finding
    #: Region of the recipe that it lies in; empty: none.
    region: str
    #: By the recipe's tolerances.
    verdict: Verdict
    #: Which size decided, for people.
    limit: str


@dataclass(frozen=True)
class Judgement:
    """What is known of a part."""

    #: Of the part; why, in one line.
    verdict: Verdict
    reason: str
    #: Those that count, in the order of their numbers.
    findings: tuple[Judged, ...]
    #: Of the area to inspect.
    coverage: Coverage
    #: The recipe's measures, once the part is finished.
    figures: tuple[Figure, ...] = ()
    #: What was wrong with contact, force or data meanwhile.
    contact: tuple[str, ...] = ()


@dataclass(frozen=True)
class Inspected:
    """A part that is finished."""

    #: Its name.
    part: str
    #: Map, findings and alignment.
    found: Found
    #: What the recipe says of it.
    judgement: Judgement


def judge_findings(recipe: Recipe, findings: Iterable[Finding]) -> tuple[Judged, ...]:
    """Findings within the area to inspect, by the recipe's tolerances."""
    out = []
    recipe_from_base = inverse_pose(recipe.base_from_recipe)
    for finding in findings:
        x, y, _ = recipe_from_base[:3, :3] @ finding.center_m + recipe_from_base[:3, 3]
        inside = tuple(n for n, region in recipe.regions.items() if region.contains(x, y))
        if set(inside) & set(recipe.exclude):
            continue
        if recipe.inspect and not set(inside) & set(recipe.inspect):
            continue
        out.append(_judged(recipe, finding, inside))
    return tuple(out)


def _judged(recipe: Recipe, finding: Finding, inside: tuple[str, ...]) -> Judged:
    tolerance = recipe.tolerance(finding.kind, inside)
    region = tolerance.region or next(iter(inside), "")
    verdicts: dict[str, Verdict] = {}
    for name, most in tolerance.limits().items():
        value, u = abs(getattr(finding, name)), getattr(finding.uncertainty, name)
        verdicts[name] = decide(value, u, -math.inf, most, recipe.decision)
    # The worst of its sizes decides.
    for verdict in ("nonconform", "inconclusive", "unmeasured"):
        bad = next((name for name, v in verdicts.items() if v == verdict), None)
        if bad is not None:
            return Judged(finding, region, verdict, f"{_limit(bad, tolerance.limits()[bad])}")
    first, most = next(iter(tolerance.limits().items()))
    return Judged(finding, region, "conform", _limit(first, most))


def _limit(name: str, most: float) -> str:
    size, _, unit = name.rpartition("_")
    word, scale = ("µm", 1e6) if name == "depth_m" else _UNITS[unit]
    return f"{size} at most {most * scale:g} {word}"


def judge(
    recipe: Recipe,
    findings: Iterable[Finding],
    coverage: Coverage,
    doubts: Iterable[str] = (),
    figures: Iterable[Figure] = (),
    contact: Iterable[str] = (),
) -> Judgement:
    """The verdict of a part that is finished.

    Parameters
    ----------
    recipe : Recipe
        What is allowed.
    findings : iterable of Finding
        All.
    coverage : Coverage
        Of the area to inspect.
    doubts : iterable of str
        What keeps the part from being conform, such as a reference that doesn't fit.
    figures : iterable of Figure
        The recipe's measures.
    contact : iterable of str
        What was wrong with contact, force or data: such a part is never conform.
    """
    judged, doubts, figures = judge_findings(recipe, findings), list(doubts), tuple(figures)
    enough = coverage.area_m2 > 0 and coverage.unmeasured <= 1 - recipe.least_coverage + 1e-9
    verdicts = [*(j.verdict for j in judged), *(f.verdict for f in figures)]
    verdict = part_verdict(verdicts, enough, bool(doubts))
    contact = tuple(contact)
    if contact and verdict == "conform":
        verdict = "inconclusive"
    more = [*doubts, *contact]
    if verdict == "conform" and not textured(coverage, recipe.grid_m):
        verdict = "inconclusive"
        more.append("too little texture to be sure: defects between what was measured are not seen")
    reason = _reason(recipe, judged, coverage, more, enough, figures)
    return Judgement(verdict, reason, judged, coverage, figures, contact)


def _reason(
    recipe: Recipe,
    judged: tuple[Judged, ...],
    coverage: Coverage,
    doubts: list[str],
    enough: bool,
    figures: tuple[Figure, ...],
) -> str:
    bad = sum(j.verdict == "nonconform" for j in judged)
    unclear = sum(j.verdict not in ("conform", "nonconform") for j in judged)
    parts = []
    if not coverage.area_m2:
        parts.append("nothing was measured")
    elif not enough:
        parts.append(
            f"{1 - coverage.unmeasured:.1%} of the area to inspect was measured or continued, the "
            f"recipe asks for {recipe.least_coverage:.1%}"
            + (f"; the scan reached {coverage.scanned:.1%} of it" if coverage.scanned < 1 else "")
        )
    parts += doubts
    if bad:
        parts.append(f"{bad} of {len(judged)} findings out of tolerance")
    if unclear:
        parts.append(f"{unclear} findings as near to their limit as they are uncertain")
    if wrong := sum(f.verdict == "nonconform" for f in figures):
        parts.append(f"{wrong} of {len(figures)} measures out of tolerance")
    if unsure := sum(f.verdict in ("inconclusive", "unmeasured") for f in figures):
        parts.append(f"{unsure} of {len(figures)} measures can't be decided")
    if not parts:
        parts.append(f"{len(judged)} findings, all within tolerance" if judged else "no findings")
    return "; ".join(parts)


def judge_nothing(recipe: Recipe, part: str) -> Inspected:
    """A part of which there is no point."""
    found = Found(None, None, (), None, Coverage(), ())
    figures = measure_all(recipe, None, CellUncertainty.create({}))
    return Inspected(part, found, judge(recipe, (), Coverage(), (), figures))


def with_faults(judgement: Judgement, faults: Iterable[str], lost: float = 0.0) -> Judgement:
    """A judgement of a scan with faults in it: it never says that the part is good.

    Parameters
    ----------
    judgement : Judgement
        Of what was seen.
    faults : iterable of str
        Of the recording.
    lost : float
        Share of the event packets that never came.
    """
    if judgement.verdict != "conform":
        return judgement
    if list(faults):
        why = "the scan has faults"
    elif lost > MOST_MISSING:
        why = f"{lost:.0%} of the event packets were lost"
    else:
        return judgement
    return replace(judgement, verdict="inconclusive", reason=f"{judgement.reason}; but {why}")


def coverage_of_area(recipe: Recipe, height_map: HeightMap | None, scanned: Coverage) -> Coverage:
    """Coverage of the area that a recipe names; what the scan didn't reach is unmeasured.

    Parameters
    ----------
    recipe : Recipe
        Regions to inspect and to leave out.
    height_map : HeightMap or None
        The whole.
    scanned : Coverage
        Of what was scanned, for recipes without regions.
    """
    if height_map is None or not (recipe.inspect or recipe.exclude):
        return scanned
    fine = step = height_map.step_m
    map_from_recipe = inverse_pose(height_map.base_from_map) @ recipe.base_from_recipe
    if recipe.inspect:
        # A grid of the regions, which may reach beyond the map's.
        regions = [recipe.regions[name] for name in recipe.inspect]
        corners = np.concatenate([region.outline() for region in regions])
        low, high = corners.min(axis=0), corners.max(axis=0)
        fine = max(fine, math.sqrt(float(np.prod(high - low)) / _MOST_CELLS))
        axes = zip(low, high, strict=True)
        x, y = np.meshgrid(*(np.arange(low + fine / 2, high, fine) for low, high in axes))
        inside = np.logical_or.reduce([region.contains(x, y) for region in regions])
        mx, my = moved(map_from_recipe, x, y)
        column = np.rint((mx - height_map.x_m[0]) / step).astype(np.int64)
        row = np.rint((my - height_map.y_m[0]) / step).astype(np.int64)
        there = (row >= 0) & (row < height_map.shape[0])
        there &= (column >= 0) & (column < height_map.shape[1])
        state = np.full(x.shape, OUTSIDE, np.uint8)
        state[there] = height_map.state[row[there], column[there]]
    else:
        state = height_map.state
        inside = state != OUTSIDE
        x, y = moved(inverse_pose(map_from_recipe), *np.meshgrid(height_map.x_m, height_map.y_m))
    for name in recipe.exclude:
        inside &= ~recipe.regions[name].contains(x, y)
    area_m2 = int(inside.sum()) * fine**2
    return coverage_of_cells(state[inside], area_m2, scanned.points_per_mm2)
