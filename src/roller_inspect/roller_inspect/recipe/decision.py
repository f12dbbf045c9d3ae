"""Whether a figure conforms: ISO 14253-1."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

Rule = Literal["iso_14253_1", "simple_acceptance"]
Verdict = Literal["conform", "nonconform", "inconclusive", "unmeasured"]


def decide(
    value: float,
    uncertainty: float,
    low: float,
    high: float,
    rule: Rule = "iso_14253_1",
) -> Verdict:
    """Whether a measured value lies between two limits.

    Parameters
    ----------
    value : float
        Measured; NaN: it was not.
    uncertainty : float
        Expanded uncertainty U (k = 2), same unit; NaN: unknown.
    low, high : float
        What is allowed, limits included.
    rule : str
        ``iso_14253_1``: conform if value ± U lies within, nonconform if it lies outside, else
        inconclusive. ``simple_acceptance``: the value alone counts.
    """
    if not math.isfinite(value):
        return "unmeasured"
    u = 0.0 if rule == "simple_acceptance" else uncertainty
    if low <= value - u and value + u <= high:
        return "conform"
    if value - u > high or value + u < low:
        return "nonconform"
    return "inconclusive"  # also with an uncertainty that isn't known


def part_verdict(
    verdicts: Iterable[Verdict], measured_enough: bool, doubts: bool = False
) -> Verdict:
    """Verdict of a part from those of its findings and measures.

    What was not looked at is never conform, whatever was found elsewhere.

    Parameters
    ----------
    verdicts : iterable of str
        Of all findings and measures.
    measured_enough : bool
        Whether the least coverage was reached.
    doubts : bool
        Whether anything else keeps the part from being conform, such as an alignment that failed.
    """
    found = set(verdicts)
    if not measured_enough:
        return "unmeasured"
    if "nonconform" in found and not doubts:
        return "nonconform"
    if doubts or found - {"conform"}:
        return "inconclusive"
    return "conform"
