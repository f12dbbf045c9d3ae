"""The doctor's results for people and for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

from rich.table import Table
from rich.text import Text

from .result import Result

_COLOURS = {"OK": "green", "warning": "yellow", "fault": "bold red"}


def as_table(results: Sequence[Result]) -> Table:
    """A table: what was checked, how it is, what was found and what to do."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for title in ("check", "", "found", "what to do"):
        table.add_column(title, overflow="fold")
    for r in results:
        table.add_row(Text(r.name), Text(r.level, _COLOURS[r.level]), Text(r.found), Text(r.advice))
    return table


def as_json(results: Sequence[Result]) -> str:
    """The same as JSON: `faults`, `warnings` and `checks`."""
    counts = {f"{level}s": sum(r.level == level for r in results) for level in ("fault", "warning")}
    return json.dumps(
        {**counts, "checks": [asdict(r) for r in results]}, indent=1, ensure_ascii=False
    )
