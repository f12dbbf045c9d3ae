"""The report's findings: a table, and a picture with a profile of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from roller_inspect.height_map.height_map import CONTINUED, F32, HeightMap

from .html import WORDS, table, with_u
from .map_section import Pictured, axes, local
from .pictures import data_uri, map_picture
from .svg import Chart

_DETAIL_PX = 410
#: Findings that are drawn one by one; the table has all.
_MOST_DETAILS = 40
#: Sizes in the table, in which unit, with how many digits and whether signed.
_SHOWN = (
    ("length_m", 1e3, 2, False), ("width_m", 1e3, 2, False), ("depth_m", 1e6, 0, True),
    ("area_m2", 1e6, 2, False), ("volume_m3", 1e9, 3, True),
)  # fmt: skip
#: Around a finding, m at least, and by its length.
_MARGIN_M, _MARGIN = 1e-3, 0.6


def findings_section(document: Mapping[str, Any], pictured: Pictured | None) -> str:
    """Table of all findings, and cards of the deepest."""
    found = document["findings"]
    if not found:
        return "<section><h2>Findings</h2><p>None above the limits of discrimination.</p></section>"
    head = ("no.", "kind", "region", "x, y mm", "length mm", "width mm", "depth µm", "area mm²",
            "volume mm³", "sure", "verdict")  # fmt: skip
    rows = [_finding_row(f) for f in found]
    worst = sorted(found, key=lambda f: -abs(f["depth_m"]))[:_MOST_DETAILS]
    cards = "".join(_card(f, pictured) for f in worst) if pictured is not None else ""
    more = (
        f"<p>Drawn are the {_MOST_DETAILS} deepest of {len(found)}.</p>"
        if len(found) > _MOST_DETAILS
        else ""
    )
    note = (
        '<p class="legend">Depths: + extra, − missing, as the skin followed the surface; it '
        "bridges what is narrower than about half a millimetre. ± U: expanded uncertainty, k = 2. "
        "≥: at least, by size; the finding goes on beyond what was searched."
        "</p>"
    )
    return (
        f"<section><h2>Findings</h2>{table(head, rows)}{note}{more}"
        f'<div class="cards">{cards}</div></section>'
    )


def _finding_row(f: Mapping[str, Any]) -> list[str]:
    u, (x, y, _) = f["uncertainty"], f["center_m"]
    return [
        str(f["id"]),
        f["kind"],
        escape(f["region"] or "–"),
        f"{x * 1e3:.2f}, {y * 1e3:.2f}".replace("-", "−"),
        *(
            "≥ " * (name in f["at_least"]) + with_u(f[name], u[name], scale, digits, sign=sign)
            for name, scale, digits, sign in _SHOWN
        ),
        f"{f['confidence']:.2f}",
        f'<b class="{f["verdict"]}">{WORDS[f["verdict"]].lower()}</b>',
    ]


def _card(f: Mapping[str, Any], pictured: Pictured) -> str:
    """A finding's picture and its profile along its length."""
    grid = pictured.height_map
    x, y = local(grid, f["outline_m"])
    margin = max(_MARGIN_M, _MARGIN * f["length_m"])
    columns = _within(grid.x_m, x.min() - margin, x.max() + margin)
    rows = _within(grid.y_m, y.min() - margin, y.max() + margin)
    part, deviation = grid.cropped(columns, rows), pictured.deviation_m[rows, columns]
    scale = max(2 * pictured.tolerance_m, abs(f["depth_m"]))
    chart = axes(part, _DETAIL_PX)
    chart.image(data_uri(map_picture(deviation, part.state, scale, _DETAIL_PX)))
    chart.outline(x * 1e3, y * 1e3, f"found {f['verdict']}")
    ends = _longest(x, y, margin / 2)
    (x0, y0), (x1, y1) = ends
    chart.outline(np.array([x0, x1]) * 1e3, np.array([y0, y1]) * 1e3, "cut")
    u = f["uncertainty"]["depth_m"]
    words = (
        f"<b>{f['id']}</b> {f['kind']}, {'at least ' if f['at_least'] else ''}"
        f"{f['length_m'] * 1e3:.2f} × {f['width_m'] * 1e3:.2f} mm, "
        f"{with_u(f['depth_m'], u, 1e6, 0, sign=True)} µm"
        + (" (seen by edges alone)" if f["cues"] == ["edges"] else "")
        + (f", edge raised by {f['rim_m'] * 1e6:.0f} µm: " if f["rim_m"] else ": ")
        + f'<b class="{f["verdict"]}">{WORDS[f["verdict"]].lower()}</b>'
        + (f"; {escape(f['limit'])}" if f.get("limit") else "")
    )
    profile = _profile(part, deviation, ends, f["depth_limit_m"])
    return f"<figure><figcaption>{words}</figcaption>{chart}{profile}</figure>"


def _profile(
    part: HeightMap, deviation: F32, ends: tuple[tuple[float, float], ...], limit_m: float | None
) -> str:
    """Deviation along a line with ±2σ, over the depth that is allowed; none where unmeasured."""
    (x0, y0), (x1, y1) = ends
    length = math.hypot(x1 - x0, y1 - y0)
    at = np.linspace(0.0, 1.0, max(2, round(length / part.step_m)))
    column = np.rint((x0 + at * (x1 - x0) - part.x_m[0]) / part.step_m).astype(int)
    row = np.rint((y0 + at * (y1 - y0) - part.y_m[0]) / part.step_m).astype(int)
    column, row = column.clip(0, part.shape[1] - 1), row.clip(0, part.shape[0] - 1)
    known = part.state[row, column] >= CONTINUED
    height = np.where(known, deviation[row, column], np.nan) * 1e6
    two_sigma = 2e6 * part.sigma_m[row, column]
    t = (limit_m or 0.0) * 1e6
    reach = max(1.3 * t, 1.0, float(np.nanmax(np.abs(height))) * 1.15 if known.any() else 0.0)
    chart = Chart((0, length * 1e3), (-reach, reach), "along, mm", "deviation, µm", _DETAIL_PX, 170)
    if limit_m is not None:
        chart.band(-t, t)
    for edge in (height - two_sigma, height + two_sigma):
        chart.line(at * length * 1e3, edge.clip(-reach, reach), "sigma")
    chart.line(at * length * 1e3, height)
    return str(chart)


def _longest(x: np.ndarray, y: np.ndarray, margin: float) -> tuple[tuple[float, float], ...]:
    """A line through the middle of an outline, along its longest way, with a margin."""
    points = np.stack([x, y], axis=-1)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    spread = points - points.mean(axis=0)
    along = np.linalg.svd(spread, full_matrices=False)[2][0]
    reach = np.abs((points - middle) @ along).max() + margin
    a, b = middle - along * reach, middle + along * reach
    return (float(a[0]), float(a[1])), (float(b[0]), float(b[1]))


def _within(axis: np.ndarray, low: float, high: float) -> slice:
    first, last = np.searchsorted(axis, [low, high])
    return slice(max(int(first) - 1, 0), min(int(last) + 1, len(axis)))
