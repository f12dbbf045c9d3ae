"""A finding: one place where the surface differs from its reference."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from roller_core.transforms import F64

from .uncertainty import Budget, Uncertainty

#: After ISO 8785: a hollow without and with a raised edge, a hollow or groove more than three
#: times as long as wide, a rise; and material that is missing or extra against CAD or golden scan.
Kind = Literal["dent", "crater", "scratch", "raised", "missing", "extra"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, eq=False)
class Finding:
    """One place where the surface differs from its reference."""

    #: Number; it stays from when the finding is first reported.
    id: int
    #: One of `KINDS`.
    kind: Kind
    #: Centre of its area on the surface, frame base. Shape (3,).
    center_m: F64 = field(repr=False)
    #: Of the smallest rectangle around its outline, the longer side first.
    length_m: float
    width_m: float
    #: Largest deviation from the reference, + extra, − missing, along the outward normal, as the
    #: skin followed it.
    depth_m: float
    #: Area; integral of the deviation over it, signed as the depth.
    area_m2: float
    volume_m3: float
    #: Of each, k = 2.
    uncertainty: Uncertainty = field(repr=False)
    #: 0–1: how surely it is no chance.
    confidence: float
    #: Closed polygon around it (the first corner isn't repeated), frame base. Shape (n, 3).
    outline_m: F64 = field(repr=False)
    #: Measured points in it.
    points: int
    #: Share of its area that was measured, 0–1.
    measured: float
    #: What it was seen by: ``height``, ``edges``.
    cues: tuple[str, ...]
    #: False while more of it may come.
    final: bool
    #: Height of a crater's raised edge, the median around it; 0 of other kinds. A crater's outline,
    #: length, width and area include the edge, its volume is that of the hollow.
    rim_m: float = 0.0
    #: What the uncertainty of its depth is made of.
    budget: Budget | None = field(default=None, repr=False)
    #: Names of the figures that are at least what is given, as it goes on beyond the border of what
    #: was searched.
    at_least: tuple[str, ...] = ()
