"""Cells that hang together, and what they measure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from roller_inspect.height_map.height_map import F32, MEASURED, Bools, HeightMap
from roller_inspect.references.reference import Comparison

from .cues import SCALES_M, Cues, cell_weights, connected, disc, distance, smoothed
from .finder_settings import FindingSettings
from .finding import Finding, Kind
from .uncertainty import uncertainty

#: Width of the ring around a finding that its depth counts from, m.
_RING_M = (3e-4, 1.2e-3)
#: Part of a finding's depth at which its outline runs.
_OUTLINE = 0.2
#: A hollow is a crater if around it, in rings so wide and up to so far, m, the surface rises by
#: more than this part of its depth and of the noise. Tuned on the virtual cell.
_RIM, _RIM_NOISE, _RIM_STEP_M, _RIM_M = 0.03, 1 / 3, 2e-4, 1.2e-3
#: No rim is told where less than this share is known.
_RIM_KNOWN = 0.5
#: Beyond, up to here, m, lies what the rim rises above.
_BEYOND_RIM_M = 1.8e-3
#: Longer than so many widths is a scratch.
_SCRATCH = 3.0
#: Depth is the mean of this share of the deepest cells.
_DEEPEST = 0.05
#: The deep part is deeper than this share, and has so many cells, or the deepest ones stand alone.
_DEEP, _LEAST_APEX = 0.75, 30
#: Strong places of one finding are two if both rise so many times above what is strong.
_STANDS_OUT = 3.0
#: Distance over which points share their errors, m: smoothing by a Gaussian of 0.6 mm, an area of
#: 4.5 mm², halves them.
_ALIKE_M = 1.1e-3
#: From this share of measured cells on they are spread over a finding.
_SPREAD = 0.2
#: z at which a finding is as good as certain.
_CERTAIN_Z = 15.0


@dataclass(frozen=True)
class Component:
    """Cells of one sign that hang together."""

    #: Window around them.
    rows: slice
    columns: slice
    #: Of the window.
    mask: Bools
    #: +1 extra, −1 missing.
    sign: int

    def holds(self, row: int, column: int) -> bool:
        """Whether a cell of the map is one of them."""
        i, j = row - self.rows.start, column - self.columns.start
        inside = 0 <= i < self.mask.shape[0] and 0 <= j < self.mask.shape[1]
        return inside and bool(self.mask[i, j])

    def share_in(self, other: Component) -> float:
        """Share of its cells that are another's too."""
        rows, columns = np.nonzero(self.mask)
        rows += self.rows.start - other.rows.start
        columns += self.columns.start - other.columns.start
        inside = (rows >= 0) & (rows < other.mask.shape[0])
        inside &= (columns >= 0) & (columns < other.mask.shape[1])
        return float(other.mask[rows[inside], columns[inside]].sum()) / len(rows)


def components(cues: Cues) -> list[Component]:
    """Weak cells that hang together with a strong one, by sign; what only touches is parted."""
    found = []
    for sign in (1, -1):
        weak = cues.weak & (np.sign(cues.z) == sign)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(weak.astype(np.uint8))
        for number in np.unique(labels[cues.strong & weak]):
            x, y, width, height, _ = stats[number]
            box = slice(y, y + height), slice(x, x + width)
            mask = labels[box] == number
            found += [
                Component(*box, part, sign)
                for part in _parted(mask, np.abs(cues.z[box]), cues.strong[box])
            ]
    return sorted(found, key=lambda c: (c.columns.start, c.rows.start, c.sign))


def _parted(mask: Bools, size: F32, strong: Bools) -> list[Bools]:
    """Cells by the nearest of several strong places that stand far above what joins them."""
    sure_cells = mask & strong
    count, labels = cv2.connectedComponents(sure_cells.astype(np.uint8))
    peaks = np.zeros(count)
    np.maximum.at(peaks, labels[sure_cells], size[sure_cells])
    sure = np.flatnonzero(peaks > _STANDS_OUT * size[sure_cells].min())
    if len(sure) < 2:
        return [mask]
    places = np.where(np.isin(labels, sure), labels, 0)
    nearest = ndimage.distance_transform_edt(
        places == 0, return_distances=False, return_indices=True
    )
    return [mask & (places[tuple(nearest)] == number) for number in sure]


def measure(
    number: int,
    component: Component,
    height_map: HeightMap,
    comparison: Comparison,
    cues: Cues,
    settings: FindingSettings,
    models_part: bool,
    final: bool,
) -> tuple[Finding, Component] | None:
    """Figures of a component, and the cells in its outline; None if it is below the limits.

    Detection is by smoothed heights, measuring at the finest scale: smoothing takes the depth out
    of what is narrow. A crater's outline goes around its raised edge. What is no deeper than the
    scatter of heights (k = 2) is none, unless edges are dense there.
    """
    step = height_map.step_m
    hollow = component.sign < 0 and not models_part
    margin = round((_BEYOND_RIM_M if hollow else _RING_M[1]) / step) + 2
    window = (
        slice(max(component.rows.start - margin, 0), component.rows.stop + margin),
        slice(max(component.columns.start - margin, 0), component.columns.stop + margin),
    )
    part = height_map.cropped(window[1], window[0])
    deviation = comparison.deviation_m[window]
    mask = np.zeros(part.shape, bool)
    at = (component.rows.start - window[0].start, component.columns.start - window[1].start)
    mask[at[0] : at[0] + component.mask.shape[0], at[1] : at[1] + component.mask.shape[1]] = (
        component.mask
    )
    others = cues.weak[window] & ~mask
    weight = cell_weights(part, deviation)
    fine, share = smoothed(deviation, weight, max(SCALES_M[0] / step, 0.5))
    known = (share > 0) & np.isfinite(fine) & part.known
    away_m = distance(~mask) * step
    ring = (away_m > _RING_M[0]) & (away_m < _RING_M[1]) & known & ~others
    noise = float(np.nan_to_num(cues.noise_m[0]))
    level = float(np.median(fine[ring])) if ring.sum() >= 20 and not models_part else 0.0
    signed = component.sign * (fine - level)
    inside = mask & known
    if not inside.any():
        return None
    depth = _depth(signed, component.sign * (deviation - level), inside & (weight > 0))
    if depth <= 0:
        return None
    # The outline: where a part of the depth is reached, within reach of what was detected.
    limit = max(_OUTLINE * depth, min(2.0 * noise, 0.5 * depth))
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    grown = cv2.dilate(mask.astype(np.uint8), cross, iterations=max(1, round(2e-4 / step))) > 0
    shape = _filled(connected(known & (signed > limit) & grown, mask))
    if not shape.any():
        return None
    outline, center, length, width = _outline(shape, part)
    area = int(shape.sum()) * step**2
    volume = component.sign * float(np.nansum(np.where(shape & known, signed, 0.0))) * step**2
    points = int(part.points[shape].sum(dtype=np.int64))
    limits = settings.limits
    if (
        length < limits.length_m
        or width < limits.width_m
        or depth < limits.depth_m
        or area < limits.area_m2
        or points < limits.points
    ):
        return None
    kind, rim, hollow_m = _kind(component.sign, length, width, models_part), 0.0, width
    if kind == "dent":
        other_hollows = others & (cues.z[window] < 0)
        rim, level_there, reach = _rim(fine, shape, known & ~other_hollows, step)
        if rim > _RIM * depth + _RIM_NOISE * noise:
            kind, depth = "crater", depth + level_there - level
            shape = cv2.dilate(shape.astype(np.uint8), disc(reach / step)) > 0
            outline, center, length, width = _outline(shape, part)
            area = int(shape.sum()) * step**2
    largest = float(np.abs(cues.z[window][mask]).max())
    reference = float(np.median(comparison.sigma_m[window][mask]))
    sure = shape & (part.state == MEASURED)
    measured = float(sure.sum() / shape.sum())
    shown = math.hypot(noise, float(np.nan_to_num(cues.noise_m[-1])))
    if sure.any():
        # What the points of this place say of themselves, where that is more.
        places = max(1.0, length / _ALIKE_M) * max(1.0, area / length / _ALIKE_M)
        claimed = float(np.median(part.sigma_m[sure]))
        noise = max(noise, claimed / math.sqrt(places if measured >= _SPREAD else 1.0))
    scatter = noise, float(np.nan_to_num(cues.noise_m[-1]))
    u, budget = uncertainty(
        scatter, reference, comparison.by_pose, (length, width, depth),
        area, hollow_m, step, settings.cell,
    )  # fmt: skip
    seen_by = _named(cues, window, mask)
    # Points may claim more than they err by: the middle of what they claim and what is seen. Dense
    # edges speak for themselves: what they lie off by is less sure than that they do.
    doubt = math.hypot((shown + budget.scatter) / 2, reference)
    if seen_by == ("height",) and depth < 2 * doubt:
        return None
    middle = part.in_base(center[0], center[1], float(np.median(part.height_m[shape & known])))
    finding = Finding(
        id=number,
        kind=kind,
        center_m=middle,
        length_m=length,
        width_m=width,
        depth_m=component.sign * depth,
        area_m2=area,
        volume_m3=volume,
        uncertainty=u,
        confidence=float(np.clip(largest / _CERTAIN_Z, 0.0, 1.0)),
        outline_m=outline,
        points=points,
        measured=measured,
        cues=seen_by,
        final=final,
        rim_m=rim if kind == "crater" else 0.0,
        budget=budget,
    )
    rows, columns = (slice(w.start, w.start + n) for w, n in zip(window, shape.shape, strict=True))
    return finding, Component(rows, columns, shape, component.sign)


def _depth(signed: F32, raw: F32, inside: Bools) -> float:
    """Extreme of a finding, with its sign: the apex of a paraboloid through its deep part.

    The mean of the deepest cells would be too shallow for what is round; the deepest cell alone
    too deep, as errors have it.
    """
    values = np.sort(signed[inside])[::-1]
    if not len(values):
        return 0.0
    depth = float(values[: max(3, round(_DEEPEST * len(values)))].mean())
    rows, columns = np.nonzero(inside & (signed > _DEEP * depth))
    if depth <= 0 or len(rows) < _LEAST_APEX:
        return depth
    u, v = columns - columns.mean(), rows - rows.mean()
    basis = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    found = np.linalg.lstsq(basis, raw[rows, columns].astype(np.float64), rcond=None)[0]
    return float(np.percentile(basis @ found, 98))


def _filled(shape: Bools) -> Bools:
    """Cells with the holes in them."""
    out = shape.astype(np.uint8)
    around, _ = cv2.findContours(out, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(out, around, -1, 1, cv2.FILLED) > 0


def _outline(shape: Bools, part: HeightMap) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Outline in base, centre in the map, length and width of the smallest rectangle."""
    step = part.step_m
    found, _ = cv2.findContours(shape.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    corners = np.concatenate(found) if len(found) > 1 else found[0]
    _, sides, _ = cv2.minAreaRect(corners)
    rows, columns = np.nonzero(shape)
    center = np.array([part.x_m[columns].mean(), part.y_m[rows].mean()])
    longest = max(found, key=cv2.contourArea)[:, 0]
    heights = part.height_m[longest[:, 1], longest[:, 0]]
    heights = np.where(np.isfinite(heights), heights, np.nanmedian(part.height_m))
    outline = part.in_base(part.x_m[longest[:, 0]], part.y_m[longest[:, 1]], heights)
    # Contours run through the centres of border cells.
    length, width = max(sides) * step + step, min(sides) * step + step
    return outline, center, float(length), float(width)


def _named(cues: Cues, window: tuple[slice, slice], mask: Bools) -> tuple[str, ...]:
    edges = cues.edges[window] & mask
    height = cues.strong[window] & mask & ~edges
    return ("height",) * bool(height.any()) + ("edges",) * bool(edges.any())


def _kind(sign: int, length: float, width: float, models_part: bool) -> Kind:
    if models_part:
        return "extra" if sign > 0 else "missing"
    if sign > 0:
        return "raised"
    return "scratch" if length > _SCRATCH * width else "dent"


def _rim(height: F32, shape: Bools, usable: Bools, step: float) -> tuple[float, float, float]:
    """How high the surface rises around a hollow, above which level, and up to where, metres.

    By medians of rings: a rise on one side alone is none of a rim.
    """
    away = distance(~shape) * step
    beyond = usable & (away > _RIM_M) & (away <= _BEYOND_RIM_M)
    if not beyond.any() or usable[away <= _BEYOND_RIM_M].mean() < _RIM_KNOWN:
        return 0.0, 0.0, 0.0
    level = float(np.median(height[beyond]))
    ends = np.arange(_RIM_STEP_M, _RIM_M + 1e-9, _RIM_STEP_M)
    rings = [usable & (away > end - _RIM_STEP_M) & (away <= end) for end in ends]
    rises = np.array([np.median(height[r]) - level if r.any() else -np.inf for r in rings])
    top = int(np.argmax(rises))
    low = np.flatnonzero(rises[top:] < 0.5 * rises[top])
    last = top + int(low[0]) - 1 if len(low) else len(ends) - 1
    return float(rises[top]), level, float(ends[last])
