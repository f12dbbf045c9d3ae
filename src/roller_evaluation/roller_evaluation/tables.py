"""Results on the screen and in files: tables and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as RichTable

from roller_core.plain_json import to_text

#: Columns of the tables where they go to a file.
_WIDTH = 130


@dataclass(frozen=True)
class Table:
    """A table of text."""

    #: What it shows.
    title: str
    #: Names of the columns.
    head: tuple[str, ...]
    #: Cells.
    rows: Sequence[tuple[str, ...]]
    #: What is to be said below it.
    note: str = ""


def write_json(result: dict[str, Any], path: Path) -> None:
    """Write all figures."""
    path.write_text(to_text(result), encoding="utf-8")


def markdown_page(title: str, about: str, found: Sequence[Table]) -> str:
    """A page of tables."""
    return "\n\n".join([f"# {title}", about, *(markdown(table) for table in found)]) + "\n"


def markdown(table: Table) -> str:
    """A table with its title and note."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (table.head, *table.rows)]
    lines.insert(1, "|" + "---|" * len(table.head))
    note = f"\n\n{table.note}" if table.note else ""
    return f"## {table.title}\n\n" + "\n".join(lines) + note


def number(value: float | None, digits: int = 1) -> str:
    """A number for a cell."""
    return "–" if value is None else f"{value:.{digits}f}"


def share(value: float | None) -> str:
    """A share for a cell, in per cent."""
    return "–" if value is None else f"{value:.0%}"


def show_tables(shown_tables: Sequence[Table]) -> None:
    """Print tables."""
    console = Console()
    width = console.width if console.is_terminal else _WIDTH
    for table in shown_tables:
        shown = RichTable(
            title=table.title,
            caption=table.note or None,
            title_justify="left",
            caption_justify="left",
            box=SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
        )
        # A heading may wrap; of figures nothing is cut, however narrow the screen.
        columns = zip(table.head, *table.rows, strict=True)
        least = [max(map(len, (*head.split(), *cells))) for head, *cells in columns]
        for k, name in enumerate(table.head):
            shown.add_column(
                name, justify="left" if k == 0 else "right", no_wrap=k == 0, min_width=least[k]
            )
        for row in table.rows:
            shown.add_row(*row)
        Console(width=max(width, sum(least) + 2 * len(least) + 2)).print(shown, crop=False)
