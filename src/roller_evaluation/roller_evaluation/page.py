"""The evaluation as one page that needs nothing beside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from .tables import Table

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem; padding: 0 1rem;
       color: #1c1c1c; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.4rem; }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .8rem; border-bottom: 1px solid #ddd; text-align: right;
         white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
th { border-bottom: 2px solid #888; font-weight: 600; }
p.note { color: #444; max-width: 60rem; } img { max-width: 100%; }
details { margin: .6rem 0; } pre { overflow-x: auto; background: #f5f5f5; padding: .8rem; }
figure { margin: 1rem 0; } figcaption { color: #444; } .wide { overflow-x: auto; }
"""


def page(
    sections: Sequence[tuple[str, Sequence[Table], Sequence[tuple[str, bytes]]]],
    facts: Mapping[str, Any],
    settings: str,
) -> str:
    """The page's HTML.

    Parameters
    ----------
    sections : sequence of (title, tables, figures)
        A figure is its caption and a PNG.
    facts : mapping
        What is said of the run, by name.
    settings : str
        All settings, as text.
    """
    facts_table = Table("This run", ("", ""), [(k, str(v)) for k, v in facts.items()])
    parts = [
        "<!doctype html>", '<html lang="en"><head><meta charset="utf-8">',
        "<title>Evaluation of the roller</title>", f"<style>{_STYLE}</style></head><body>",
        "<h1>Evaluation of the roller</h1>",
        "<p>The paper's experiments on the virtual cell, beside the paper's figures of a real "
        "sensor. The virtual cell was not fitted to them: compare methods within a table, and "
        "orders of magnitude with the paper.</p>",
        f"<details><summary>This run</summary>{_table(facts_table)}</details>",
    ]  # fmt: skip
    for title, tables, figures in sections:
        parts.append(f"<h2>{escape(title)}</h2>")
        parts += [_table(table) for table in tables]
        parts += [_figure(caption, png) for caption, png in figures]
    parts.append(
        f"<details><summary>Settings</summary><pre>{escape(settings)}</pre></details></body></html>"
    )
    return "\n".join(parts) + "\n"


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in table.head)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        for row in table.rows
    )  # fmt: skip
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    return f'<div class="wide"><table><tr>{head}</tr>{rows}</table></div>{note}'


def _figure(caption: str, png: bytes) -> str:
    data = base64.b64encode(png).decode()
    return (
        f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )
