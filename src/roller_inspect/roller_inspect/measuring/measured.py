"""A measured figure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: The extreme of a region or profile stands out of the noise if it is so many times as uncertain
#: as one height: there are many to choose from.
STANDS_OUT = 3.5

Unit = Literal["m", "m²", "m³", "rad"]


@dataclass(frozen=True)
class Measured:
    """A figure, or why there is none."""

    #: In `unit`; None where it can't be measured.
    value: float | None
    #: Expanded, k = 2, in `unit`; NaN without a value.
    uncertainty: float
    #: ``m``, ``m²``, ``m³`` or ``rad``.
    unit: Unit
    #: Why there is no value; empty where there is one.
    reason: str = ""


def not_measurable(unit: Unit, reason: str) -> Measured:
    """A figure that can't be measured."""
    return Measured(None, float("nan"), unit, f"not measurable: {reason}")
