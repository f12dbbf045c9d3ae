"""Lines of a field with what their drift depends on."""

from __future__ import annotations

from dataclasses import dataclass

from roller_core.transforms import F64

from .fit import I64


@dataclass(frozen=True)
class LinePoints:
    """Lines of a field with what their drift depends on; arrays of shape (n,)."""

    #: Place on the grid, px.
    row: F64
    column: F64
    #: As the fit has it, drift and all.
    offset: F64
    #: 0 for OFF, 1 for ON events.
    polarity: I64
    #: dh/dx of the surface, h towards the camera.
    slope: F64
    #: How fast the events get more along the crossing: mean of the rays' slopes less the middle of
    #: the aperture, by their variance.
    lean: F64
    #: The same of the cell around; see `crossing_change`.
    change: F64
    #: See `wall_side`.
    side: F64
    #: Uncertainty of the height but for drift, metres.
    sigma_m: F64
    #: Width of the band in which its events lie, one deviation, metres; 0: unknown.
    width_m: F64
    #: Speed of the camera when its events came, m/s.
    speed_m_s: F64
