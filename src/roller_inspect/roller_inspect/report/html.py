"""Pieces of the report's HTML, and figures in words."""

from __future__ import annotations

from collections.abc import Iterable

#: Verdicts as the report says them.
WORDS = {
    "conform": "Conform",
    "nonconform": "Not conform",
    "inconclusive": "Inconclusive",
    "unmeasured": "Unmeasured",
}


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
