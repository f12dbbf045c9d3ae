"""Findings that go on beyond what was searched: their sizes are lower bounds."""

from __future__ import annotations

import numpy as np

from roller_inspect.height_map.gaps import grown
from roller_inspect.height_map.height_map import F32, Bools

from .cues import distance

#: Fewest cells in which a finding meets the border: fewer are ragged.
_LEAST_CELLS = 3
#: The last cells before where nothing is known are ragged: so many may lie between.
_REACH = 2
#: A finding that is deeper than this share of its depth so near to the border, m, may be deeper
#: beyond it.
_DEEP, _NEAR_M = 0.9, 1.5e-4


def lower_bounds(
    shape: Bools, signed: F32, known: Bools, outer: Bools, least_m: float, depth_m: float,
    step_m: float,
) -> tuple[str, ...]:  # fmt: skip
    """Names of a finding's figures that are at least what was measured; none if it was whole.

    Parameters
    ----------
    shape : ndarray of bool, shape (ny, nx)
        Its cells.
    signed : ndarray of float32, shape (ny, nx)
        Deviation, positive towards its depth, metres.
    known, outer : ndarray of bool, shape (ny, nx)
        Cells with a height; those beyond the border of what is searched. Beyond these arrays
        nothing is known.
    least_m : float
        Deviation at its outline.
    depth_m : float
        Its depth, positive.
    step_m : float
        Edge of a cell.
    """
    with np.errstate(invalid="ignore"):
        goes_on = np.pad(outer & known & (signed > least_m), _REACH)
    nothing = np.pad(outer & ~known, _REACH, constant_values=True)
    own = np.pad(shape, _REACH)
    meets = (grown(own, 1) & goes_on | grown(own, _REACH) & nothing) & ~own
    if meets.sum() < _LEAST_CELLS:
        return ()
    near = (distance(~meets) * step_m <= _NEAR_M)[_REACH:-_REACH, _REACH:-_REACH] & shape & known
    deep = bool(near.any()) and float(signed[near].max()) > _DEEP * depth_m
    return (*("depth_m",) * deep, "length_m", "width_m", "area_m2", "volume_m3")
