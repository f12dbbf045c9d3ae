"""Findings as the page lists them, worst first, from a file or from messages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from .grid import F64

#: Verdicts, worst first; others come after them.
VERDICTS = ("nonconform", "inconclusive", "unmeasured", "conform")
_WORDS = ("id", "kind", "verdict", "limit")
#: Figures of a finding that have an uncertainty.
FIGURES = ("length_m", "width_m", "depth_m", "area_m2", "volume_m3")


def listed(findings: Iterable[Mapping[str, Any]], map_from_base: F64) -> list[dict[str, Any]]:
    """Findings in the order of how bad they are, with their places in the map.

    Parameters
    ----------
    findings : iterable of mapping
        As in `inspection.json`; what is missing or no figure is left out.
    map_from_base : ndarray, shape (4, 4)
        Of the map that the page shows.

    Returns
    -------
    list of dict
        Beside the finding's own keys `at_m` and `outline_at_m`, metres in the map.
    """
    out = []
    for number, finding in enumerate(findings, 1):
        shown: dict[str, Any] = {"id": str(number), "kind": "finding", "verdict": ""}
        shown |= {key: str(finding[key])[:80] for key in _WORDS if key in finding}
        shown |= _figures({key: finding.get(key) for key in (*FIGURES, "confidence")})
        if isinstance(uncertainty := finding.get("uncertainty"), Mapping):
            shown["uncertainty"] = _figures(uncertainty)
        center = _points([finding.get("center_m")])
        if center is not None:
            shown["center_m"] = center[0].tolist()
            shown["at_m"] = _moved(map_from_base, center)[0]
        outline = _points(finding.get("outline_m"))
        if outline is not None and len(outline) > 1:
            shown["outline_at_m"] = _moved(map_from_base, outline)
        out.append(shown)
    return sorted(out, key=badness)


def plain_finding(message: Any) -> dict[str, Any]:
    """A finding of a message (roller_msgs/Finding) as in `inspection.json`."""

    def point(p: Any) -> list[float]:
        return [p.x, p.y, p.z]

    plain = {
        "id": message.id,
        "kind": message.kind,
        "verdict": message.verdict,
        "confidence": message.confidence,
        "center_m": point(message.center),
        "outline_m": [point(corner) for corner in message.outline],
        "uncertainty": {},
    }
    for key in FIGURES:
        name = key.rpartition("_")[0]
        plain[key] = getattr(message, name)
        plain["uncertainty"][key] = getattr(message, f"{name}_uncertainty")
    return plain


def badness(finding: Mapping[str, Any]) -> tuple[float, ...]:
    """Sorts the worst first: by verdict, then by depth, then by area."""
    verdict = finding.get("verdict", "")
    rank = VERDICTS.index(verdict) if verdict in VERDICTS else len(VERDICTS)
    return rank, -abs(finding.get("depth_m", 0.0)), -finding.get("area_m2", 0.0)


def _figures(values: Mapping[str, Any]) -> dict[str, float]:
    """What of it is a figure."""
    return {
        str(key): float(value)
        for key, value in values.items()
        if isinstance(value, int | float) and math.isfinite(value)
    }


def _points(rows: Any) -> F64 | None:
    """Points (n, 3) of lists of two or three coordinates; None if they are something else."""
    try:
        points = np.array(rows, np.float64)
    except (TypeError, ValueError):
        return None
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not np.isfinite(points).all():
        return None
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def _moved(matrix: F64, points: F64) -> list[list[float]]:
    return np.round(points @ matrix[:2, :3].T + matrix[:2, 3], 6).tolist()
