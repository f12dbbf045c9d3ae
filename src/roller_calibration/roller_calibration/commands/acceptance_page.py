"""A cell's certificate as a page."""

from __future__ import annotations

from html import escape
from typing import Any

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:46em;margin:3em auto;padding:0 1em}"
    "table{border-collapse:collapse;width:100%}td,th{text-align:left;padding:.3em .6em;"
    "border-bottom:1px solid #bbb}.yes{color:#176b2c}.no{color:#a3161a}"
)


def certificate_page(certificate: dict[str, Any]) -> str:
    """The certificate to print and sign: HTML.

    Parameters
    ----------
    certificate : dict
        As in `certificate.json`.
    """
    rows = "".join(_rows(name, gauge) for name, gauge in certificate["gauges"].items())
    camera = certificate["camera"]
    facts = {
        "date": certificate["date"],
        "skin": certificate["skin"] or "–",
        "camera": f"{camera['width']}×{camera['height']}, fx {camera['intrinsics'][0]:.1f} px",
        "light": certificate["light"],
        "edge drift": certificate["edge_drift"],
        "golden scan": certificate["golden"] or "–",
        "recordings": ", ".join(certificate["data"]),
        "their SHA-256": ", ".join(text[:16] for text in certificate["sha256"]),
        "calibrations": ", ".join(f"{k} {v}" for k, v in certificate["calibrations"].items())
        or "–",
    }
    reasons = "".join(f"<li>{escape(line)}</li>" for line in certificate["reasons"])
    listed = "".join(
        f"<tr><th>{escape(k)}</th><td>{escape(str(v))}</td></tr>\n" for k, v in facts.items()
    )
    mark = "yes" if certificate["verdict"] == "accepted" else "no"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Acceptance</title>'
        f"<style>{_STYLE}</style></head><body><h1>Acceptance of the cell</h1>"
        f'<p><b class="{mark}">{certificate["verdict"].upper()}</b></p><ul>{reasons}</ul>'
        "<table><tr><th></th><th>this cell</th><th>limit</th><th>virtual cell</th></tr>\n"
        f"{rows}</table><p>The virtual cell's own gauges, with this camera and speed and without a "
        "calibration; under a printed skin where this cell's is, and its plate always.</p>"
        "<p>* Edges that drift bend a sphere, and no radius is measured more surely than they let "
        "it: one within the limit may be wrong by as much as that is wide. The virtual cell's "
        "sphere has 4 mm.</p>"
        f"<table>{listed}</table><p>Signed</p></body></html>\n"
    )


def _rows(name: str, gauge: dict[str, Any]) -> str:
    """A gauge's figures, one a row."""
    from roller_calibration.reached import GAUGES

    size = f", {gauge['size_m'] * 1e3:g} mm" if gauge["size_m"] else ""
    size += ", printed skin" if gauge["reached"]["printed"] else ""
    rows = f'<tr><th colspan="4">{name}{size}</th></tr>\n'
    form = (GAUGES[name].form, "form_m", 1e6, " µm", "≤ ")
    if (radii := gauge["limits"]["radius_m"]) is not None:
        low, high = (f"{r * 1e3:.2f}" for r in radii)
        shown = [f"{gauge[which]['radius_m'] * 1e3:.2f} mm" for which in ("reached", "promised")]
        shown.insert(1, f"{low} to {high} mm")
        rows += "<tr><td>radius as seen*</td>" + "".join(f"<td>{c}</td>" for c in shown) + "</tr>\n"
    for what, key, scale, unit, side in (
        ("mean error", "error_m", 1e6, " µm", "≤ "),
        *([form] if radii is None else []),
        ("seen", "coverage", 100, " %", "≥ "),
        ("errors within 2 σ", "within", 100, " %", "≥ "),
        ("points", "points", 1, "", ""),
    ):
        limit = gauge["limits"].get(key)
        cells = [f"{gauge[which][key] * scale:.0f}{unit}" for which in ("reached", "promised")]
        cells.insert(1, "–" if limit is None else f"{side}{limit * scale:.0f}{unit}")
        rows += f"<tr><td>{what}</td>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>\n"
    return rows
