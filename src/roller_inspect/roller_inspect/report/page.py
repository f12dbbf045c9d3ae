"""`inspection.html`: one page without scripts or outside files, that prints as it looks."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from importlib import resources
from typing import Any

import numpy as np

from .findings_section import findings_section
from .html import WORDS, measure_words, pair, table
from .map_section import Pictured, map_section


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
    files = resources.files(__package__)
    style = "".join(files.joinpath(f"{n}.css").read_text("utf-8") for n in ("style", "charts"))
    body = [
        _head(document, part),
        map_section(document, pictured) if pictured is not None else "",
        findings_section(document, pictured),
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
        f'<p class="verdict {verdict}"><strong>{WORDS[verdict]}</strong>'
        f"<span>{escape(document['reason'])}</span></p>",
        '<dl class="key">',
        pair("Measured", f"{cover['measured']:.1%}"),
        pair("Continued", f"{cover['continued']:.1%}"),
        pair("Unmeasured", f"{cover['unmeasured']:.1%}"),
        pair("Findings", f"{len(found)}, {out} out of tolerance"),
        pair("Reference", escape(document["reference"]["text"])),
        pair("Inspected", escape(trace["time"])),
        "</dl>",
        f'<p class="{"note" if texture["sufficient"] else "warn"}">{escape(texture["text"])}</p>',
    ]
    lines += [f'<p class="warn">{escape(fault)}</p>' for fault in document["faults"]]
    return "\n".join(lines)


def _measures(document: Mapping[str, Any]) -> str:
    if not document["measures"]:
        return ""
    rows = []
    for m in document["measures"]:
        value, limits, verdict = measure_words(m)
        word = f'<b class="{verdict}">{WORDS[verdict].lower()}</b>' if verdict in WORDS else verdict
        rows.append(
            [escape(m["name"]), m["tool"], escape(m["of"]), value, limits, word,
             escape(m["reason"])]
        )  # fmt: skip
    head = ("name", "tool", "of", "value ± U", "limits", "verdict", "")
    return f"<section><h2>Measures</h2>{table(head, rows)}</section>"


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
    budgets = table(("no.", "kind", "depth µm", *sources, "U (k = 2)"), rows) if rows else ""
    words = "".join(f"<li><b>{n}</b>: {escape(text)}</li>" for n, text in sources.items())
    return (
        "<section><h2>Uncertainty</h2><p>Of depths, standard contributions in µm; U is twice their "
        f"root of squares.</p>{budgets}<ul>{words}</ul></section>"
    )


def _coverage(document: Mapping[str, Any]) -> str:
    c, t = document["coverage"], document["texture"]
    rows = [
        ["area to inspect", f"{c['area_m2'] * 1e6:.1f} mm²"],
        ["of it scanned", f"{c['scanned']:.1%}"],
        ["measured", f"{c['measured']:.1%}"],
        ["continued from measured cells beside", f"{c['continued']:.1%}"],
        ["unmeasured", f"{c['unmeasured']:.1%}"],
        ["least coverage that the recipe asks for", f"{c['least']:.1%}"],
        ["measured points", f"{c['points_per_mm2']:.1f} a mm²"],
        ["events", f"{t['events_per_mm2']:.0f} a mm²" if t["events_per_mm2"] else "not known"],
    ]
    return (
        f"<section><h2>Coverage</h2>{table((), rows)}"
        f"<p>{escape(t['text'])} {escape(t['shown_for'])}</p></section>"
    )


def _alignment(document: Mapping[str, Any]) -> str:
    a = document["alignment"]
    if a is None:
        return ""
    moved = np.asarray(a["correction"])
    middle = np.asarray(a["middle_m"])
    shift = ", ".join(f"{v * 1e6:.0f}" for v in moved[:3, :3] @ middle + moved[:3, 3] - middle)
    turns = (moved[2, 1] - moved[1, 2], moved[0, 2] - moved[2, 0], moved[1, 0] - moved[0, 1])
    turn = ", ".join(f"{1e3 * v / 2:.2f}" for v in turns)
    residual = "–" if a["residual_m"] is None else f"{a['residual_m'] * 1e6:.1f} µm"
    rows = [
        ["reference", escape(document["reference"]["text"])],
        ["refined beyond the robot's pose", escape(", ".join(a["refined"]) or "nothing")],
        ["correction x, y, z at the middle", f"{shift} µm"],
        ["turn about x, y, z", f"{turn} mrad"],
        ["residual (robust, without findings)", residual],
        ["cells that it rests on", f"{a['cells']:,}"],
    ]
    return f"<section><h2>Alignment</h2>{table((), rows)}</section>"


def _traceability(document: Mapping[str, Any]) -> str:
    rows = []
    for name, value in document["traceability"].items():
        if isinstance(value, Mapping):
            value = ", ".join(f"{k} {v}" for k, v in value.items() if v not in (None, ""))
        rows.append([escape(name.replace("_", " ")), escape(_text(value))])
    sign = '<p class="sign"><span>Inspected by</span><span>Date</span><span>Released by</span></p>'
    return f"<section><h2>Traceability</h2>{table((), rows)}{sign}</section>"


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


def _text(value: Any) -> str:
    return "not known" if value in (None, "") else str(value)
