"""Where findings lie on a map, and which of them are the same place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from roller_core.transforms import inverse_pose
from roller_inspect.height_map.height_map import HeightMap

from .finding import Finding

#: Findings so near to the border of two pieces are looked for in both, m.
BORDER_M = 1e-3
#: Findings nearer than this are the same one, seen again, in part of their length.
_SAME = 0.5


def findings_inside(
    findings: Iterable[Finding], window: HeightMap, margin_m: float = 0.0
) -> list[Finding]:
    """Those whose centre lies on a map, or so near to it along its x.

    Parameters
    ----------
    findings : iterable of Finding
        Findings.
    window : HeightMap
        The map.
    margin_m : float
        How near, metres.
    """
    findings = list(findings)
    centres = np.array([f.center_m for f in findings]).reshape(-1, 3)
    x = (centres - window.base_from_map[:3, 3]) @ window.base_from_map[:3, 0]
    margin_m += window.step_m / 2
    there = (window.x_m[0] - margin_m <= x) & (x <= window.x_m[-1] + margin_m)
    return [f for f, here in zip(findings, there.tolist(), strict=True) if here]


def findings_beside(
    fresh: Sequence[Finding], findings: Sequence[Finding], window: HeightMap
) -> list[Finding]:
    """Of findings those that one of some on a map may be the same as.

    Parameters
    ----------
    fresh : sequence of Finding
        Those on the map.
    findings : sequence of Finding
        All.
    window : HeightMap
        The map.
    """
    longest_m = max((f.length_m for f in (*fresh, *findings)), default=0.0)
    return findings_inside(findings, window, BORDER_M + _SAME * longest_m)


def cell_of(finding: Finding, height_map: HeightMap) -> tuple[int, int]:
    """Row and column of a finding's centre."""
    map_from_base = inverse_pose(height_map.base_from_map)
    x, y, _ = map_from_base[:3, :3] @ finding.center_m + map_from_base[:3, 3]
    row, column = (np.argmin(np.abs(a - b)) for a, b in ((height_map.y_m, y), (height_map.x_m, x)))
    return int(row), int(column)


def same_place(one: Finding, other: Finding) -> bool:
    """Whether two findings are the same place."""
    return (one.depth_m > 0) == (other.depth_m > 0) and math.dist(
        one.center_m, other.center_m
    ) < _SAME * max(one.length_m, other.length_m)
