"""Pieces of the report's HTML, and figures in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

#: Verdicts as the report says them.
WORDS = {
    "conform": "Conform",
    "nonconform": "Not conform",
    "inconclusive": "Inconclusive",
    "unmeasured": "Unmeasured",
}

#: Of SI units what reports give, with the factor and digits; of lengths below 1 mm µm.
_UNITS = {
    "m": (1e3, 3, "mm"), "m²": (1e6, 3, "mm²"), "m³": (1e9, 3, "mm³"), "rad": (1e3, 2, "mrad"),
}  # fmt: skip


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table; one with a head is of figures, which scroll rather than break."""
    top = "".join(f"<th>{name}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    if not top:
        return f"<table><tbody>{body}</tbody></table>"
    return (
        f'<div class="wide"><table class="figures"><thead><tr>{top}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def pair(name: str, value: str) -> str:
    """A term and what it is."""
    return f"<div><dt>{name}</dt><dd>{value}</dd></div>"


def with_u(
    value: float | None, u: float | None, scale: float, digits: int, sign: bool = False
) -> str:
    """A figure with its expanded uncertainty, both times a scale."""
    if value is None:
        return "–"
    number = signed(value * scale, digits) if sign else f"{value * scale:.{digits}f}"
    return number if u is None else f"{number} ± {u * scale:.{digits}f}"


def signed(value: float, digits: int = 1) -> str:
    """A number with its sign."""
    return f"{value:+.{digits}f}".replace("-", "−")


def measure_words(m: Mapping[str, Any]) -> tuple[str, str, str]:
    """Value with U, limits and verdict of a recipe's measure, with their unit; – for none."""
    given = [v for v in (m["value"], m["low"], m["high"]) if v is not None]
    scale, digits, unit = _UNITS[m["unit"]]
    if unit == "mm" and max(map(abs, given), default=0.0) < 1e-3:
        scale, digits, unit = 1e6, 1, "µm"
    ends = ["–" if v is None else signed(v * scale, digits) for v in (m["low"], m["high"])]
    limited = ends != ["–", "–"]
    value = with_u(m["value"], m["uncertainty"], scale, digits, sign=True)
    return (
        value if m["value"] is None else f"{value} {unit}",
        f"{' … '.join(ends)} {unit}" if limited else "–",
        m["verdict"] if limited else "–",
    )
