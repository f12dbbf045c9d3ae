"""What a check found and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Level = Literal["OK", "warning", "fault"]


@dataclass(frozen=True)
class Result:
    """One line of the doctor's table.

    Parameters
    ----------
    name : str
        What was checked.
    level : str
        `OK`; `warning`: something works less well or not at all, which may not matter; `fault`:
        what was asked for, or the graph, will not work.
    found : str
        What is.
    advice : str
        What to do; empty where nothing is to be done.
    """

    name: str
    level: Level
    found: str
    advice: str = ""


def worst(levels: Sequence[Level]) -> Level:
    """The worst of some levels; `OK` of none."""
    order: tuple[Level, ...] = ("OK", "warning", "fault")
    return max(levels, key=order.index, default="OK")
