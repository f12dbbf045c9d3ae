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
    """One place where the surface differs from its reference.

    Attributes
    ----------
    id : int
        Number; it stays from when the finding is first reported.
    kind : str
        One of `KINDS`.
    center_m : ndarray of float64, shape (3,)
        Centre of its area on the surface, frame base.
    length_m, width_m : float
        Of the smallest rectangle around its outline, the longer side first.
    depth_m : float
        Largest deviation from the reference, + extra, − missing, along the outward normal, as the
        skin followed it.
    area_m2, volume_m3 : float
        Area; integral of the deviation over it, signed as the depth.
    uncertainty : Uncertainty
        Of each, k = 2.
    confidence : float
        0–1: how surely it is no chance.
    outline_m : ndarray of float64, shape (n, 3)
        Closed polygon around it (the first corner isn't repeated), frame base.
    points : int
        Measured points in it.
    measured : float
        Share of its area that was measured, 0–1.
    cues : tuple of str
        What it was seen by: ``height``, ``edges``.
    final : bool
        False while more of it may come.
    rim_m : float
        Height of a crater's raised edge, the median around it; 0 of other kinds. A crater's
        outline, length, width and area include the edge, its volume is that of the hollow.
    budget : Budget or None
        What the uncertainty of its depth is made of.
    """

    id: int
    kind: Kind
    center_m: F64 = field(repr=False)
    length_m: float
    width_m: float
    depth_m: float
    area_m2: float
    volume_m3: float
    uncertainty: Uncertainty = field(repr=False)
    confidence: float
    outline_m: F64 = field(repr=False)
    points: int
    measured: float
    cues: tuple[str, ...]
    final: bool
    rim_m: float = 0.0
    budget: Budget | None = field(default=None, repr=False)
