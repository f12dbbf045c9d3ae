"""From what was found on a part to its verdict, by its recipe."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from roller_core.seq_gaps import MOST_MISSING
from roller_core.transforms import inverse_pose

from .covered_area import enough
from .findings import CellUncertainty, Finding
from .height_map.coverage import Coverage, textured
from .measures import Figure, measure_all
from .pieces import Found
from .recipe import Recipe, decide, part_verdict
from .recipe.decision import Verdict
from .recipe.regions import in_polygon
from .recipe.tolerance import Tolerance

_UNITS = {"m": ("mm", 1e3), "m2": ("mm²", 1e6), "m3": ("mm³", 1e9)}
#: A finding is looked at in so many places along x and along y.
_PLACES = 24
#: Verdicts, the worst last.
_WORSE: tuple[Verdict, ...] = ("conform", "unmeasured", "inconclusive", "nonconform")


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
    #: Depth that it may have there; None where its tolerance is of other sizes.
    depth_limit_m: float | None = None
    #: Whether only what of it was searched is within its limits.
    cut: bool = False


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
    """Findings that reach into the area to inspect, by the recipe's tolerances.

    One that lies in several regions is held against the tolerance of each; the worst counts.
    """
    out = []
    for finding in findings:
        held = {}
        for inside in _regions_of(recipe, finding):
            if set(inside) & set(recipe.exclude):
                continue
            if recipe.inspect and not set(inside) & set(recipe.inspect):
                continue
            held[recipe.tolerance(finding.kind, inside)] = inside
        judged = [_judged(tolerance, finding, inside, recipe) for tolerance, inside in held.items()]
        if judged:
            out.append(max(judged, key=lambda each: _WORSE.index(each.verdict)))
    return tuple(out)


def _regions_of(recipe: Recipe, finding: Finding) -> list[tuple[str, ...]]:
    """The regions of each place within its outline: every combination that there is once."""
    if not recipe.regions:
        return [()]
    pose = inverse_pose(recipe.base_from_recipe)
    x, y, _ = pose[:3, :3] @ finding.center_m + pose[:3, 3]
    outline = (finding.outline_m @ pose[:3, :3].T + pose[:3, 3])[:, :2]
    low, high = outline.min(axis=0), outline.max(axis=0)
    grid = np.meshgrid(*np.linspace(low, high, _PLACES).T)
    within = in_polygon(outline, *grid)
    x, y = (np.append(inner[within], middle) for inner, middle in zip(grid, (x, y), strict=True))
    inside = np.stack([region.contains(x, y) for region in recipe.regions.values()])
    return [
        tuple(name for name, there in zip(recipe.regions, row, strict=True) if there)
        for row in dict.fromkeys(map(tuple, inside.T.tolist()))
    ]


def _judged(
    tolerance: Tolerance, finding: Finding, inside: tuple[str, ...], recipe: Recipe
) -> Judged:
    region = tolerance.region or next(iter(inside), "")
    verdicts: dict[str, Verdict] = {}
    open_sizes = set()
    for name, most in tolerance.limits().items():
        value, u = abs(getattr(finding, name)), getattr(finding.uncertainty, name)
        verdicts[name] = decide(value, u, -math.inf, most, recipe.decision)
        # What was seen is within: the whole may not be.
        if verdicts[name] == "conform" and name in finding.at_least:
            verdicts[name] = "inconclusive"
            open_sizes.add(name)
    # The worst of its sizes decides.
    for verdict in ("nonconform", "inconclusive", "unmeasured"):
        bad = next((name for name, v in verdicts.items() if v == verdict), None)
        if bad is not None:
            limit = _limit(bad, tolerance.limits()[bad])
            cut = bad in open_sizes
            limit += ", and it goes on beyond what was searched" * cut
            return Judged(finding, region, verdict, limit, tolerance.depth_m, cut)
    first, most = next(iter(tolerance.limits().items()))
    return Judged(finding, region, "conform", _limit(first, most), tolerance.depth_m)


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
    lacking: Iterable[str] = (),
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
    lacking : iterable of str
        What else wasn't measured, compared or searched enough.
    """
    judged, doubts, figures = judge_findings(recipe, findings), list(doubts), tuple(figures)
    lacking = tuple(lacking)
    verdicts = [*(j.verdict for j in judged), *(f.verdict for f in figures)]
    verdict = part_verdict(verdicts, enough(recipe, coverage) and not lacking, bool(doubts))
    contact = tuple(contact)
    if contact and verdict == "conform":
        verdict = "inconclusive"
    more = [*lacking, *doubts, *contact]
    if verdict == "conform" and not textured(coverage, recipe.grid_m):
        verdict = "inconclusive"
        more.append("too little texture to be sure: defects between what was measured are not seen")
    reason = _reason(recipe, judged, coverage, more, figures)
    return Judgement(verdict, reason, judged, coverage, figures, contact)


def _reason(
    recipe: Recipe,
    judged: tuple[Judged, ...],
    coverage: Coverage,
    doubts: list[str],
    figures: tuple[Figure, ...],
) -> str:
    bad = sum(j.verdict == "nonconform" for j in judged)
    cut = sum(j.cut for j in judged)
    unclear = sum(j.verdict not in ("conform", "nonconform") for j in judged) - cut
    parts = []
    if not coverage.area_m2:
        parts.append("nothing was measured")
    elif not enough(recipe, coverage):
        parts.append(
            f"{1 - coverage.unmeasured:.1%} of the area to inspect was measured or continued, the "
            f"recipe asks for {recipe.least_coverage:.1%}"
            + (f"; the scan reached {coverage.scanned:.1%} of it" if coverage.scanned < 1 else "")
        )
    parts += doubts
    if bad:
        parts.append(f"{bad} of {len(judged)} findings out of tolerance")
    if unclear:
        parts.append(
            "1 finding as near to its limit as it is uncertain"
            if unclear == 1
            else f"{unclear} findings as near to their limit as they are uncertain"
        )
    if cut:
        some = "1 finding goes" if cut == 1 else f"{cut} findings go"
        parts.append(f"{some} on beyond what was searched: how large in all is not known")
    if wrong := sum(f.verdict == "nonconform" for f in figures):
        parts.append(f"{wrong} of {len(figures)} measures out of tolerance")
    if unsure := sum(f.verdict in ("inconclusive", "unmeasured") for f in figures):
        parts.append(f"{unsure} of {len(figures)} measures can't be decided")
    if not parts:
        some = "1 finding, within" if len(judged) == 1 else f"{len(judged)} findings, all within"
        parts.append(f"{some} tolerance" if judged else "no findings")
    return "; ".join(parts)


def longest_part(parts: Iterable[Inspected], recipe: Recipe, part: str) -> Inspected:
    """Of parts the one of most area; one without a point where there is none."""
    area = attrgetter("judgement.coverage.area_m2")
    return max(parts, key=area, default=None) or judge_nothing(recipe, part)


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
