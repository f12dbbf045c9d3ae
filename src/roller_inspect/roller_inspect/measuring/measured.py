"""A measured figure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Unit = Literal["m", "m²", "m³", "rad"]


@dataclass(frozen=True)
class Measured:
    """A figure, or why there is none.

    Attributes
    ----------
    value : float or None
        In `unit`; None where it can't be measured.
    uncertainty : float
        Expanded, k = 2, in `unit`; NaN without a value.
    unit : str
        ``m``, ``m²``, ``m³`` or ``rad``.
    reason : str
        Why there is no value; empty where there is one.
    """

    value: float | None
    uncertainty: float
    unit: Unit
    reason: str = ""


def not_measurable(unit: Unit, reason: str) -> Measured:
    """A figure that can't be measured."""
    return Measured(None, float("nan"), unit, f"not measurable: {reason}")
