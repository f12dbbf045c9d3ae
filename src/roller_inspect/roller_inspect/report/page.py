"""`inspection.html`: one page without scripts or outside files, that prints as it looks."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any

import numpy as np

from roller_inspect.height_map.height_map import CONTINUED, F32, HeightMap

from .pictures import data_uri, map_picture
from .svg import Chart

#: A row of the map holds so much length at least, m, and the page so many rows at most.
_ROW_M, _MOST_ROWS = 0.12, 12
_MAP_PX, _DETAIL_PX = 860, 410
#: Findings that are drawn one by one; the table has all.
_MOST_DETAILS = 40
#: Around a finding, m at least, and by its length.
_MARGIN_M, _MARGIN = 1e-3, 0.6
_WORDS = {
    "conform": "Conform",
    "nonconform": "Not conform",
    "inconclusive": "Inconclusive",
    "unmeasured": "Unmeasured",
}


@dataclass(frozen=True)
class Pictured:
    """What the page shows beside the words of `inspection.json`.

    Attributes
    ----------
    height_map : HeightMap
        The map.
    deviation_m : ndarray of float32, shape (ny, nx)
        From the reference, metres.
    tolerance_m : float
        Depth that most of the part may have; the scale of colours is twice that.
    """

    height_map: HeightMap
    deviation_m: F32
    tolerance_m: float


def page(document: Mapping[str, Any], pictured: Pictured | None) -> str:
    """The report of an inspection.

    Parameters
    ----------
    document : mapping
        What `inspection.json` holds.
    pictured : Pictured, optional
        The map; None where there is none.
    """
    part = escape(str(document["part"]) or "without a number")
    style = resources.files(__package__).joinpath("style.css").read_text(encoding="utf-8")
    body = [
        _head(document, part),
        _map(document, pictured) if pictured is not None else "",
        _findings(document, pictured),
        _measures(document),
        _uncertainty(document),
        _coverage(document),
        _alignment(document),
        _traceability(document),
        _recipe(document),
    ]
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Inspection of {part}</title><style>{style}</style></head>\n<body><main>\n"
        + "\n".join(filter(None, body))
        + "\n</main></body></html>\n"
    )


def _head(document: Mapping[str, Any], part: str) -> str:
    verdict, trace = document["verdict"], document["traceability"]
    cover, texture = document["coverage"], document["texture"]
    found = document["findings"]
    out = sum(f["verdict"] == "nonconform" for f in found)
    lines = [
        f"<h1>Inspection of {part}</h1>",
        f'<p class="verdict {verdict}"><strong>{_WORDS[verdict]}</strong>'
        f"<span>{escape(document['reason'])}</span></p>",
        '<dl class="key">',
        _pair("Measured", f"{cover['measured']:.1%}"),
        _pair("Continued", f"{cover['continued']:.1%}"),
        _pair("Unmeasured", f"{cover['unmeasured']:.1%}"),
        _pair("Findings", f"{len(found)}, {out} out of tolerance"),
        _pair("Reference", escape(document["reference"]["text"])),
        _pair("Inspected", escape(trace["time"])),
        "</dl>",
        f'<p class="{"note" if texture["sufficient"] else "warn"}">{escape(texture["text"])}</p>',
    ]
    lines += [f'<p class="warn">{escape(fault)}</p>' for fault in document["faults"]]
    return "\n".join(lines)


def _map(document: Mapping[str, Any], pictured: Pictured) -> str:
    grid, deviation = pictured.height_map, pictured.deviation_m
    length = float(grid.x_m[-1] - grid.x_m[0]) + grid.step_m
    rows = min(_MOST_ROWS, max(1, math.ceil(length / _ROW_M)))
    scale = 2 * pictured.tolerance_m
    charts = []
    for columns in np.array_split(np.arange(len(grid.x_m)), rows):
        piece = slice(int(columns[0]), int(columns[-1]) + 1)
        part = grid.cropped(piece, slice(None))
        chart = _axes(part, _MAP_PX)
        chart.image(data_uri(map_picture(deviation[:, piece], part.state, scale, _MAP_PX)))
        for f in document["findings"]:
            x, y = _local(grid, f["outline_m"])
            if x.max() >= part.x_m[0] and x.min() <= part.x_m[-1]:
                chart.outline(x * 1e3, y * 1e3, f"found {f['verdict']}", str(f["id"]))
        charts.append(str(chart))
    t = pictured.tolerance_m * 1e6
    legend = (
        f'<p class="legend"><i class="ramp"></i> −{2 * t:.0f} … +{2 * t:.0f} µm from the reference '
        f"(pale within ±{t:.0f} µm); <i class='hatch'></i> not measured; white: outside the scan. "
        "+ is extra material, − missing.</p>"
    )
    return (
        "<section><h2>Deviation</h2>"
        + "".join(charts)
        + legend
        + _histogram(pictured)
        + "</section>"
    )


def _histogram(pictured: Pictured) -> str:
    """Deviation of cells that were measured or continued, with the tolerance as a band."""
    values = pictured.deviation_m[pictured.height_map.state >= CONTINUED] * 1e6
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    t = pictured.tolerance_m * 1e6
    reach = max(2.5 * t, float(np.percentile(np.abs(values), 99.8)))
    counts, edges = np.histogram(values.clip(-reach, reach), 81, (-reach, reach))
    share = counts / len(values) * 100
    # A root shows the few cells that are off beside the many that are not.
    top = float(np.sqrt(share.max()))
    chart = Chart((-reach, reach), (0, top * 1.05), "deviation, µm", "√ of % of cells", 860, 180)
    chart.band(-t, t, along="x")
    chart.bars(edges.tolist(), np.sqrt(share).tolist())
    within = float((np.abs(values) <= t).mean())
    middle, spread = (
        float(np.median(values)),
        float(1.4826 * np.median(np.abs(values - np.median(values)))),
    )
    words = (
        f"{len(values):,} cells; median {_signed(middle)} µm, robust spread {spread:.1f} µm; "
        f"{within:.2%} within ±{t:.0f} µm; what is beyond the ends is in the last bars."
    )
    return f'<h3>Distribution</h3>{chart}<p class="legend">{words}</p>'


def _findings(document: Mapping[str, Any], pictured: Pictured | None) -> str:
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
        "bridges what is narrower than about half a millimetre. ± U: expanded uncertainty, k = 2."
        "</p>"
    )
    return (
        f"<section><h2>Findings</h2>{_table(head, rows)}{note}{more}"
        f'<div class="cards">{cards}</div></section>'
    )


def _finding_row(f: Mapping[str, Any]) -> list[str]:
    u, (x, y, _) = f["uncertainty"], f["center_m"]
    return [
        str(f["id"]),
        f["kind"],
        escape(f["region"] or "–"),
        f"{x * 1e3:.2f}, {y * 1e3:.2f}",
        _with_u(f["length_m"], u["length_m"], 1e3, 2),
        _with_u(f["width_m"], u["width_m"], 1e3, 2),
        _with_u(f["depth_m"], u["depth_m"], 1e6, 0, sign=True),
        _with_u(f["area_m2"], u["area_m2"], 1e6, 2),
        _with_u(f["volume_m3"], u["volume_m3"], 1e9, 3, sign=True),
        f"{f['confidence']:.2f}",
        f'<b class="{f["verdict"]}">{_WORDS[f["verdict"]].lower()}</b>',
    ]


def _card(f: Mapping[str, Any], pictured: Pictured) -> str:
    """A finding's picture and its profile along its length."""
    grid = pictured.height_map
    x, y = _local(grid, f["outline_m"])
    margin = max(_MARGIN_M, _MARGIN * f["length_m"])
    columns = _within(grid.x_m, x.min() - margin, x.max() + margin)
    rows = _within(grid.y_m, y.min() - margin, y.max() + margin)
    part, deviation = grid.cropped(columns, rows), pictured.deviation_m[rows, columns]
    scale = max(2 * pictured.tolerance_m, abs(f["depth_m"]))
    chart = _axes(part, _DETAIL_PX)
    chart.image(data_uri(map_picture(deviation, part.state, scale, _DETAIL_PX)))
    chart.outline(x * 1e3, y * 1e3, f"found {f['verdict']}")
    ends = _longest(x, y, margin / 2)
    (x0, y0), (x1, y1) = ends
    chart.outline(np.array([x0, x1]) * 1e3, np.array([y0, y1]) * 1e3, "cut")
    u = f["uncertainty"]["depth_m"]
    words = (
        f"<b>{f['id']}</b> {f['kind']}, {f['length_m'] * 1e3:.2f} × {f['width_m'] * 1e3:.2f} mm, "
        f"{_with_u(f['depth_m'], u, 1e6, 0, sign=True)} µm"
        + (" (seen by edges alone)" if f["cues"] == ["edges"] else "")
        + (f", edge raised by {f['rim_m'] * 1e6:.0f} µm: " if f["rim_m"] else ": ")
        + f'<b class="{f["verdict"]}">{_WORDS[f["verdict"]].lower()}</b>'
        + (f"; {escape(f['limit'])}" if f.get("limit") else "")
    )
    profile = _profile(part, deviation, ends, pictured)
    return f"<figure><figcaption>{words}</figcaption>{chart}{profile}</figure>"


def _profile(
    part: HeightMap, deviation: F32, ends: tuple[tuple[float, float], ...], pictured: Pictured
) -> str:
    """Deviation along a line, dotted where cells are continued, with ±2σ; none where unmeasured."""
    (x0, y0), (x1, y1) = ends
    length = math.hypot(x1 - x0, y1 - y0)
    at = np.linspace(0.0, 1.0, max(2, round(length / part.step_m)))
    column = np.rint((x0 + at * (x1 - x0) - part.x_m[0]) / part.step_m).astype(int)
    row = np.rint((y0 + at * (y1 - y0) - part.y_m[0]) / part.step_m).astype(int)
    column, row = column.clip(0, part.shape[1] - 1), row.clip(0, part.shape[0] - 1)
    known = part.state[row, column] >= CONTINUED
    height = np.where(known, deviation[row, column], np.nan) * 1e6
    two_sigma = 2e6 * part.sigma_m[row, column]
    t = pictured.tolerance_m * 1e6
    reach = max(1.3 * t, float(np.nanmax(np.abs(height))) * 1.15 if known.any() else 0.0)
    chart = Chart((0, length * 1e3), (-reach, reach), "along, mm", "deviation, µm", _DETAIL_PX, 170)
    chart.band(-t, t)
    for edge in (height - two_sigma, height + two_sigma):
        chart.line(at * length * 1e3, edge.clip(-reach, reach), "sigma")
    chart.line(at * length * 1e3, height)
    return str(chart)


def _measures(document: Mapping[str, Any]) -> str:
    if not document["measures"]:
        return ""
    rows = []
    for m in document["measures"]:
        limits = " … ".join("–" if v is None else f"{v:.6g}" for v in (m["low"], m["high"]))
        value = f"{m['value']:.6g}" if m["value"] is not None else "–"
        if m["value"] is not None and m["uncertainty"] is not None:
            value += f" ± {m['uncertainty']:.2g}"
        rows.append(
            [escape(m["name"]), m["tool"], escape(m["of"]), f"{value} {m['unit']}", limits,
             f'<b class="{m["verdict"]}">{_WORDS[m["verdict"]].lower()}</b>', escape(m["reason"])]
        )  # fmt: skip
    head = ("name", "tool", "of", "value ± U", "limits", "verdict", "")
    return f"<section><h2>Measures</h2>{_table(head, rows)}</section>"


def _uncertainty(document: Mapping[str, Any]) -> str:
    """What U of the depths is made of, and where that is from."""
    sources = document["uncertainty"]
    rows = [
        [str(f["id"]), f["kind"], f"{f['depth_m'] * 1e6:+.0f}".replace("-", "−")]
        + [f"{f['budget_m'][name] * 1e6:.1f}" for name in sources]
        + [f"{f['uncertainty']['depth_m'] * 1e6:.0f}"]
        for f in document["findings"]
        if f["budget_m"] is not None
    ]
    table = _table(("no.", "kind", "depth µm", *sources, "U (k = 2)"), rows) if rows else ""
    words = "".join(f"<li><b>{n}</b>: {escape(text)}</li>" for n, text in sources.items())
    return (
        "<section><h2>Uncertainty</h2><p>Of depths, standard contributions in µm; U is twice their "
        f"root of squares.</p>{table}<ul>{words}</ul></section>"
    )


def _coverage(document: Mapping[str, Any]) -> str:
    c, t = document["coverage"], document["texture"]
    rows = [
        ["area to inspect", f"{c['area_m2'] * 1e6:.1f} mm²"],
        ["measured", f"{c['measured']:.1%}"],
        ["continued from measured cells beside", f"{c['continued']:.1%}"],
        ["unmeasured", f"{c['unmeasured']:.1%}"],
        ["least coverage that the recipe asks for", f"{c['least']:.1%}"],
        ["measured points", f"{c['points_per_mm2']:.1f} a mm²"],
        ["events", f"{t['events_per_mm2']:.0f} a mm²" if t["events_per_mm2"] else "not known"],
    ]
    return (
        f"<section><h2>Coverage</h2>{_table((), rows)}"
        f"<p>{escape(t['text'])} {escape(t['shown_for'])}</p></section>"
    )


def _alignment(document: Mapping[str, Any]) -> str:
    a = document["alignment"]
    if a is None:
        return ""
    moved = np.asarray(a["correction"])
    shift = ", ".join(f"{v * 1e6:.0f}" for v in moved[:3, 3])
    residual = "–" if a["residual_m"] is None else f"{a['residual_m'] * 1e6:.1f} µm"
    rows = [
        ["reference", escape(document["reference"]["text"])],
        ["refined beyond the robot's pose", escape(", ".join(a["refined"]) or "nothing")],
        ["correction x, y, z", f"{shift} µm"],
        ["residual (robust, without findings)", residual],
        ["cells that it rests on", f"{a['cells']:,}"],
    ]
    return f"<section><h2>Alignment</h2>{_table((), rows)}</section>"


def _traceability(document: Mapping[str, Any]) -> str:
    rows = []
    for name, value in document["traceability"].items():
        if isinstance(value, Mapping):
            value = ", ".join(f"{k} {v}" for k, v in value.items() if v not in (None, ""))
        rows.append([escape(name.replace("_", " ")), escape(_text(value))])
    sign = '<p class="sign"><span>Inspected by</span><span>Date</span><span>Released by</span></p>'
    return f"<section><h2>Traceability</h2>{_table((), rows)}{sign}</section>"


def _recipe(document: Mapping[str, Any]) -> str:
    text = json.dumps(document["recipe"], indent=1, ensure_ascii=False)
    rule = (
        "ISO 14253-1, U with k = 2: conform where |y| + U ≤ T, not conform where |y| − U > T, else "
        "inconclusive."
        if document["recipe"]["decision"] == "iso_14253_1"
        else "Simple acceptance: conform where |y| ≤ T."
    )
    return (
        f"<section><h2>Recipe</h2><p>{rule}</p>"
        f"<h3>{escape(document['recipe']['name'])}</h3><pre>{escape(text)}</pre></section>"
    )


def _axes(part: HeightMap, width: int) -> Chart:
    half = part.step_m / 2
    x, y = ((float(a[0]) - half, float(a[-1]) + half) for a in (part.x_m, part.y_m))
    mm = [(a * 1e3, b * 1e3) for a, b in (x, y)]
    return Chart(mm[0], mm[1], "x, mm", "y, mm", width, equal=True)


def _local(grid: HeightMap, outline_m: Iterable[Iterable[float]]) -> tuple[np.ndarray, np.ndarray]:
    """A polygon of base in the map's frame: x and y, metres."""
    points = np.asarray(list(outline_m), float).reshape(-1, 3)
    rotation, shift = grid.base_from_map[:3, :3], grid.base_from_map[:3, 3]
    local = (points - shift) @ rotation
    return local[:, 0], local[:, 1]


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


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    top = "".join(f"<th>{name}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>{f'<thead><tr>{top}</tr></thead>' if top else ''}<tbody>{body}</tbody></table>"


def _pair(name: str, value: str) -> str:
    return f"<div><dt>{name}</dt><dd>{value}</dd></div>"


def _with_u(
    value: float | None, u: float | None, scale: float, digits: int, sign: bool = False
) -> str:
    if value is None:
        return "–"
    number = _signed(value * scale, digits) if sign else f"{value * scale:.{digits}f}"
    return number if u is None else f"{number} ± {u * scale:.{digits}f}"


def _signed(value: float, digits: int = 1) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def _text(value: Any) -> str:
    return "not known" if value in (None, "") else str(value)
