"""What a check found and what to do about it, for people and for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal

from roller_core.plain_json import to_text

if TYPE_CHECKING:
    from rich.table import Table

Level = Literal["OK", "warning", "fault"]

_COLOURS = {"OK": "green", "warning": "yellow", "fault": "bold red"}


@dataclass(frozen=True)
class Result:
    """One line of the doctor's table."""

    #: What was checked.
    name: str
    #: `OK`; `warning`: something works less well or not at all, which may not matter; `fault`: what
    #: was asked for, or the graph, will not work.
    level: Level
    #: What is.
    found: str
    #: What to do; empty where nothing is to be done.
    advice: str = ""


def ok(name: str, found: str) -> Result:
    """A result that is as it should be."""
    return Result(name, "OK", found)


def warning(name: str, found: str, advice: str) -> Result:
    """A result that may matter."""
    return Result(name, "warning", found, advice)


def fault(name: str, found: str, advice: str) -> Result:
    """A result that keeps something from working."""
    return Result(name, "fault", found, advice)


def as_table(results: Sequence[Result]) -> Table:
    """A table: what was checked, how it is, what was found and what to do."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for title in ("check", "", "found", "what to do"):
        table.add_column(title, overflow="fold")
    for r in results:
        table.add_row(Text(r.name), Text(r.level, _COLOURS[r.level]), Text(r.found), Text(r.advice))
    return table


def as_json(results: Sequence[Result]) -> str:
    """The same as JSON: `faults`, `warnings` and `checks`."""
    counts = {f"{level}s": sum(r.level == level for r in results) for level in ("fault", "warning")}
    checks = [asdict(r) for r in results]
    return to_text({**counts, "checks": checks}).rstrip("\n")
