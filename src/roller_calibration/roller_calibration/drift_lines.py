"""Lines of all gauges of edge drift together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from .gauge import Gauge
from .pass_lines import WALL_SLOPE

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class GaugeLines:
    """Lines of all gauges, one after the other, shape (n,) each."""

    slope: F64
    change: F64
    side: F64
    polarity: F64
    sigma_m: F64
    width_m: F64
    speed_m_s: F64
    error_m: F64
    #: Slope of their gauge along the roll; of steps 1 or -1.
    rise: F64
    #: Whether they lie on slopes of their gauge, and whether that is a sphere.
    on_slope: Bools
    of_sphere: Bools

    @classmethod
    def of(cls, gauges: list[Gauge]) -> GaugeLines:
        """Those of some gauges."""
        of_lines = ("slope", "change", "side", "polarity", "sigma_m", "width_m", "speed_m_s")
        values = {
            name: np.concatenate([getattr(gauge.lines, name) for gauge in gauges])
            for name in of_lines
        }
        error_m, rise = (
            np.concatenate([getattr(gauge, name) for gauge in gauges])
            for name in ("error_m", "rise")
        )
        of_sphere = np.repeat([g.sphere for g in gauges], [len(g.error_m) for g in gauges])
        on_slope = np.abs(rise) > WALL_SLOPE
        return cls(error_m=error_m, rise=rise, on_slope=on_slope, of_sphere=of_sphere, **values)
