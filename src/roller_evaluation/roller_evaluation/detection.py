"""Findings of the inspection against the defects that are on a plate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from roller_inspect.findings import Finding
from roller_inspect.height_map.coverage import Coverage, coverage_of
from roller_inspect.height_map.height_map import OUTSIDE, HeightMap
from roller_inspect.references import SelfReference
from roller_inspect.surface_inspector import InspectionSettings, SurfaceInspector
from roller_sim.relief import DefectMark, Region

from .cases import Case
from .plate_surface import seen_area, surface_patches
from .rows import Row
from .scans import Scan

#: Grid on which outlines are compared, m.
_STEP_M = 5e-5
#: What lies so near to a defect, or to a rivet, belongs to it and is no false call, m.
_NEAR_M = 5e-4

Outline = npt.NDArray[np.float64]


def measure_detection(case: Case, scan: Scan) -> list[Row]:
    """Inspect a plate; a row a defect, and one of the plate with its false calls.

    The area to inspect is the scene's region `plate`, which crossed the whole view. The plate's
    row has `false_calls`, the `area_m2` scanned beside the defects, and the shares of it that were
    measured and continued. A defect's row has its true figures, `hit`, and of what was found
    there the kind and sizes.
    """
    area, view = scan.truth.objects["plate"], seen_area(scan)
    inspector = SurfaceInspector(InspectionSettings.create({}), SelfReference())
    for patch in surface_patches(case, scan, for_inspection=True):
        inspector.add(patch)
    found = inspector.finish()
    origin = scan.truth.origin_m[:2]
    targets = [m for m in scan.truth.defects if view.contains(*(m.outline + origin).T).all()]
    marks = [np.asarray(mark.outline) + origin for mark in targets]
    others = [
        np.array([[r.x0, r.y0], [r.x1, r.y0], [r.x1, r.y1], [r.x0, r.y1]])
        for name, r in scan.truth.objects.items()
        if name.startswith("rivet") and view.contains(r.x0, [r.y0, r.y1]).any()
    ]  # fmt: skip
    inside = [f for f in found.findings if area.contains(*f.center_m[:2])]
    hits, false_calls = matched(inside, marks, others)
    coverage = _coverage(found.height_map, area)
    aside = sum(footprint(outline, _NEAR_M) for outline in [*marks, *others])
    plate: Row = {
        "role": "plate",
        "false_calls": len(false_calls),
        "area_m2": max(coverage.area_m2 - aside, 0.0),
        "measured": round(coverage.measured, 4),
        "continued": round(coverage.continued, 4),
        "events": len(scan.even),
        "faults": "; ".join(found.faults),
    }
    rows = [plate]
    for k, mark in enumerate(targets):
        rows.append({"role": "defect", **_truth(mark), **_hit(hits.get(k))})
    return rows


def _coverage(height_map: HeightMap | None, area: Region) -> Coverage:
    """Coverage of what was scanned of an area."""
    if height_map is None:
        return Coverage(0.0, 0.0, 0.0, 0.0, 0.0)
    x, y = np.meshgrid(height_map.x_m, height_map.y_m)
    (a, b, _, dx), (c, d, _, dy) = height_map.base_from_map[:2]
    inside = area.contains(a * x + b * y + dx, c * x + d * y + dy)
    return coverage_of(height_map, inside & (height_map.state != OUTSIDE))


def matched(
    findings: Sequence[Finding], marks: Sequence[Outline], others: Sequence[Outline] = ()
) -> tuple[dict[int, Finding], list[Finding]]:
    """Which finding hits which defect, and findings that hit nothing.

    A finding hits the defect whose footprint it overlaps most, and no other; of several that hit
    the same, the deepest counts and the rest are parts of it.

    Parameters
    ----------
    findings : sequence of Finding
        Frame base.
    marks, others : sequence of ndarray, shape (n, 2)
        Outlines of the defects, and of what is on the plate and is none, metres in base.

    Returns
    -------
    hits : dict
        Finding by the defect's index.
    false_calls : list of Finding
        Those away from all of them.
    """
    hits: dict[int, Finding] = {}
    false_calls = []
    for finding in findings:
        outline = np.asarray(finding.outline_m)[:, :2]
        shared = [overlap(outline, mark) for mark in marks]
        best = int(np.argmax(shared)) if shared else -1
        if best >= 0 and shared[best] > 0:
            if best not in hits or abs(finding.depth_m) > abs(hits[best].depth_m):
                hits[best] = finding
        elif not any(overlap(outline, near, _NEAR_M) for near in [*marks, *others]):
            false_calls.append(finding)
    return hits, false_calls


def overlap(one: Outline, other: Outline, reach_m: float = 0.0) -> float:
    """Area that two outlines share, m²; the second may be grown."""
    low = np.minimum(one.min(axis=0), other.min(axis=0) - reach_m)
    if (one.max(axis=0) < other.min(axis=0) - reach_m).any() or (
        one.min(axis=0) > other.max(axis=0) + reach_m
    ).any():
        return 0.0
    high = np.maximum(one.max(axis=0), other.max(axis=0) + reach_m)
    first, second = _filled(one, low, high), _filled(other, low, high, reach_m)
    return float((first & second).sum()) * _STEP_M**2


def footprint(outline: Outline, reach_m: float = 0.0) -> float:
    """Area of an outline that may be grown, m²."""
    low, high = outline.min(axis=0) - reach_m, outline.max(axis=0) + reach_m
    return float(_filled(outline, low, high, reach_m).sum()) * _STEP_M**2


def _filled(
    outline: Outline, low: Outline, high: Outline, reach_m: float = 0.0
) -> npt.NDArray[np.uint8]:
    shape = np.ceil((high - low) / _STEP_M).astype(int) + 3
    mask = np.zeros((shape[1], shape[0]), np.uint8)
    cells = np.rint((outline - low) / _STEP_M).astype(np.int32) + 1
    cv2.fillPoly(mask, [cells], 1)
    reach = round(reach_m / _STEP_M)
    if reach:
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        mask = np.asarray(cv2.dilate(mask, disc), np.uint8)
    return mask


def _truth(mark: DefectMark) -> dict[str, Any]:
    return {
        "name": mark.name,
        "kind": mark.kind,
        "depth_um": round(mark.depth * 1e6, 2),
        "skin_um": round(mark.skin_depth * 1e6, 2),
        "length_mm": round(mark.length * 1e3, 4),
        "width_mm": round(mark.width * 1e3, 4),
    }


def _hit(finding: Finding | None) -> dict[str, Any]:
    if finding is None:
        return {"hit": False}
    return {
        "hit": True,
        "found_kind": finding.kind,
        "found_depth_um": round(finding.depth_m * 1e6, 2),
        "found_length_mm": round(finding.length_m * 1e3, 4),
        "found_width_mm": round(finding.width_m * 1e3, 4),
        "u_depth_um": round(finding.uncertainty.depth_m * 1e6, 2),
        "u_length_mm": round(finding.uncertainty.length_m * 1e3, 4),
        "u_width_mm": round(finding.uncertainty.width_m * 1e3, 4),
    }
