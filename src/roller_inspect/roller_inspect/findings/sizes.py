"""What cells that hang together measure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from roller_inspect.height_map.height_map import F32, MEASURED, Bools, HeightMap
from roller_inspect.references.reference import Comparison

from .components import Component
from .cues import Cues, connected, disc
from .cut import lower_bounds
from .finder_settings import FindingSettings, Limits
from .finding import Finding, Kind
from .neighbourhood import RING_M, Neighbourhood
from .rim import BEYOND_RIM_M, rim_around
from .uncertainty import uncertainty

#: Part of a finding's depth at which its outline runs.
_OUTLINE = 0.2
#: Longer than so many widths is a scratch.
_SCRATCH = 3.0
#: What has no width looks so wide, m, by the skin that bridges it and by neighbourhoods that tell
#: one depth; what is left of a width is known no better than to the second. Of scratches 0.3 to
#: 1 mm wide, tuned on plates that are none of the reports'.
_BLUR_M, _LEAST_WIDTH_M = 9e-4, 5e-4
#: Depth is the mean of this share of the deepest cells.
_DEEPEST = 0.05
#: The deep part is deeper than this share, and has so many cells, or the deepest ones stand alone.
_DEEP, _LEAST_APEX = 0.75, 30
#: Distance over which points share their errors, m: smoothing by a Gaussian of 0.6 mm, an area of
#: 4.5 mm², halves them.
ALIKE_M = 1.1e-3
#: From this share of measured cells on they are spread over a finding.
_SPREAD = 0.2
#: Square of z times the area that the points in it stand for as a rule, m²: few points, of which
#: all may be of one wrong line, must differ the more. Tuned on the virtual cell, checked on another
#: simulator.
_LEAST_EVIDENCE_M2 = 1.5e-5
#: z at which a finding is as good as certain.
_CERTAIN_Z = 15.0


@dataclass(frozen=True)
class _Size:
    """What a component measures, metres."""

    kind: Kind
    depth: float
    shape: Bools
    outline: np.ndarray
    center: np.ndarray
    length: float
    width: float
    area: float
    volume: float
    points: int
    #: Names of what is at least that.
    at_least: tuple[str, ...]
    rim: float = 0.0

    def within(self, limits: Limits) -> bool:
        """Whether it is no smaller than the limits of discrimination in any respect."""
        return (
            self.length >= limits.length_m
            and self.width >= limits.width_m
            and self.depth >= limits.depth_m
            and self.area >= limits.area_m2
            and self.points >= limits.points
        )


def measure(
    component: Component,
    height_map: HeightMap,
    comparison: Comparison,
    cues: Cues,
    settings: FindingSettings,
    models_part: bool,
) -> tuple[Finding, Component] | None:
    """Figures of a component, final, and the cells in its outline; None if below the limits.

    Detection is by smoothed heights, measuring at the finest scale: smoothing takes the depth out
    of what is narrow. A crater's outline goes around its raised edge. What is no deeper than the
    scatter of heights (k = 2), or that too few points tell, is none, unless edges are dense there.
    """
    sign = component.sign
    hollow = sign < 0 and not models_part
    margin_m = BEYOND_RIM_M if hollow else RING_M[1]
    place = Neighbourhood.around(component, height_map, comparison, cues, margin_m)
    part, window = place.part, place.window
    noise, coarse = map(float, cues.noise_m)
    level = 0.0 if models_part else place.level_around()
    size = _size(place, sign, level, noise, models_part)
    if size is None or not size.within(settings.limits):
        return None
    hollow_width = size.width
    if size.kind == "dent":
        other_hollows = place.others & (cues.z[window] < 0)
        size = _with_rim(size, place, place.known & ~other_hollows, level, noise)
    largest = float(np.abs(cues.z[window][place.mask]).max())
    reference = float(np.median(comparison.sigma_m[window][place.mask]))
    measured = float((size.shape & (part.state == MEASURED)).sum() / size.shape.sum())
    u, budget = uncertainty(
        (max(noise, _claimed(size, part, measured)), coarse), reference, comparison.by_pose,
        (size.length, size.width, size.depth), size.area, hollow_width, place.step_m, settings.cell,
    )  # fmt: skip
    seen_by = _named(cues, window, place.mask)
    # Points may claim more than they err by: the middle of what they claim and what is seen, there
    # or as usual. Dense edges speak for themselves: what they lie off by is less sure than that
    # they do.
    around = np.median(cues.noise_around_m[(slice(None), *window)][:, place.mask], axis=1)
    seen = math.hypot(*np.maximum(around, cues.noise_m))
    doubt = math.hypot((seen + max(seen, budget.scatter)) / 2, reference)
    evidence_m2 = largest**2 * size.points * cues.point_area_m2
    if seen_by == ("height",) and (size.depth < 2 * doubt or evidence_m2 < _LEAST_EVIDENCE_M2):
        return None
    middle = float(np.median(part.height_m[size.shape & place.known]))
    finding = Finding(
        id=0,
        kind=size.kind,
        center_m=part.in_base(size.center[0], size.center[1], middle),
        length_m=size.length,
        width_m=size.width,
        depth_m=sign * size.depth,
        area_m2=size.area,
        volume_m3=size.volume,
        uncertainty=u,
        confidence=float(np.clip(largest / _CERTAIN_Z, 0.0, 1.0)),
        outline_m=size.outline,
        points=size.points,
        measured=measured,
        cues=seen_by,
        final=True,
        rim_m=size.rim,
        budget=budget,
        at_least=size.at_least,
    )
    rows, columns = (
        slice(w.start, w.start + n) for w, n in zip(window, size.shape.shape, strict=True)
    )
    return finding, Component(rows, columns, size.shape, sign)


def _size(
    place: Neighbourhood, sign: int, level: float, noise: float, models_part: bool
) -> _Size | None:
    """Depth, outline and what follows from them; None where nothing stands out."""
    part, mask, known = place.part, place.mask, place.known
    signed = sign * (place.fine - level)
    inside = mask & known
    if not inside.any():
        return None
    depth = extreme(signed, sign * (place.deviation - level), inside & (place.weight > 0))
    if depth <= 0:
        return None
    # The outline: where a part of the depth is reached, within reach of what was detected.
    limit = max(_OUTLINE * depth, min(2.0 * noise, 0.5 * depth))
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    reach = max(1, round(2e-4 / place.step_m))
    grown = cv2.dilate(mask.astype(np.uint8), cross, iterations=reach) > 0
    shape = _filled(connected(known & (signed > limit) & grown, mask))
    if not shape.any():
        return None
    outline, center, length, width = _outline(shape, part)
    cell_m2 = place.step_m**2
    return _Size(
        kind=_kind(sign, length, width, models_part),
        depth=depth,
        shape=shape,
        outline=outline,
        center=center,
        length=length,
        width=width,
        area=int(shape.sum()) * cell_m2,
        volume=sign * float(np.nansum(np.where(shape & known, signed, 0.0))) * cell_m2,
        points=int(part.points[shape].sum(dtype=np.int64)),
        at_least=lower_bounds(shape, signed, known, place.outer, limit, depth, place.step_m),
    )


def _with_rim(
    size: _Size, place: Neighbourhood, usable: Bools, level: float, noise: float
) -> _Size:
    """A dent as a crater, if the surface rises around it."""
    step = place.step_m
    rim = rim_around(place.fine, size.shape, usable, step, size.depth, noise)
    if rim is None:
        return size
    shape = cv2.dilate(size.shape.astype(np.uint8), disc(rim.reach / step)) > 0
    outline, center, length, width = _outline(shape, place.part)
    return replace(
        size, kind="crater", depth=size.depth + rim.level - level, shape=shape, outline=outline,
        center=center, length=length, width=width, area=int(shape.sum()) * step**2, rim=rim.height,
    )  # fmt: skip


def _claimed(size: _Size, part: HeightMap, measured: float) -> float:
    """What the points of a place say that their mean height errs by, m; 0 without points."""
    sure = size.shape & (part.state == MEASURED)
    if not sure.any():
        return 0.0
    alike = max(1.0, size.length / ALIKE_M) * max(1.0, size.area / size.length / ALIKE_M)
    return float(np.median(part.sigma_m[sure])) / math.sqrt(alike if measured >= _SPREAD else 1.0)


def extreme(signed: F32, raw: F32, inside: Bools) -> float:
    """Highest of some cells' heights, smoothed and raw: the apex of a paraboloid through them.

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
    true_length, true_width = (math.sqrt(max(v**2 - _BLUR_M**2, 0.0)) for v in (length, width))
    return "scratch" if true_length > _SCRATCH * max(true_width, _LEAST_WIDTH_M) else "dent"
