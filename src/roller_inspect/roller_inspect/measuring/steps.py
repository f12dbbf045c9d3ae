"""Steps between regions; flushness and tilt of a fastener."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from roller_inspect.height_map.height_map import Bools, HeightMap

from .datum import Datum, datum_plane
from .measured import Measured, not_measurable

_FEW = "too few measured cells in {}"


def step_height(height_map: HeightMap, datum: Bools, top: Bools) -> Measured:
    """How much one region lies above another, at the second one's centre.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    datum, top : ndarray of bool, shape (ny, nx)
        Cells of the datum and of what is measured.
    """
    base, upper = datum_plane(height_map, datum), datum_plane(height_map, top)
    if base is None or upper is None:
        return not_measurable("m", _FEW.format("the datum" if base is None else "the region"))
    return _step(base, upper)


def _step(base: Datum, upper: Datum) -> Measured:
    x, y = upper.centre_m
    value = float(upper.at(x, y) - base.at(x, y))
    own = base.standard_uncertainty(x, y), upper.standard_uncertainty(x, y)
    return Measured(value, 2 * math.hypot(*own, base.common_m, upper.common_m), "m")


@dataclass(frozen=True)
class Fastener:
    """A fastener against the surface around it."""

    #: Height of its middle above the surface, metres.
    flushness: Measured
    #: Angle between both, radians.
    tilt: Measured
    #: What the tilt raises over the fastener's length, metres.
    rise: Measured


def fastener(height_map: HeightMap, head: Bools, around: Bools, length_m: float) -> Fastener:
    """Flushness and tilt of a fastener.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    head, around : ndarray of bool, shape (ny, nx)
        Cells of its head, and of the surface around.
    length_m : float
        Over which the tilt is given as a rise: its diameter.
    """
    base, top = datum_plane(height_map, around), datum_plane(height_map, head)
    if base is None or top is None:
        reason = _FEW.format("the surface around" if base is None else "the head")
        missing = not_measurable("m", reason)
        return Fastener(missing, not_measurable("rad", reason), missing)
    slope = np.array([top.slope_x - base.slope_x, top.slope_y - base.slope_y])
    size = float(np.hypot(*slope))
    along = slope / size if size > 0 else np.array([1.0, 0.0])
    both = (top.covariance + base.covariance)[1:, 1:]
    # What the head's errors have in common may lean as much from one side to the other.
    across_m = 2 * height_map.step_m * math.sqrt(float(head.sum()) / math.pi)
    u = math.sqrt(max(float(along @ both @ along), 0.0) + (top.common_m / across_m) ** 2)
    return Fastener(
        _step(base, top),
        Measured(float(np.arctan(size)), 2 * u, "rad"),
        Measured(size * length_m, 2 * u * length_m, "m"),
    )
