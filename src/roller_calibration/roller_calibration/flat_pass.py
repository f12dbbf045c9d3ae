"""The flat plate that a recorded pass shows."""

from __future__ import annotations

from roller_emvs.depth_settings import DepthSettings

from .constant_speed import constant_speed_part
from .contact import pass_points
from .flat import FlatPlate, find_plate
from .recordings import Scan

#: Length at one speed from which it takes a plate.
_LEAST_LENGTH_M = 0.01


def plate_of(scan: Scan, settings: DepthSettings) -> FlatPlate:
    """Find the plate that a pass rolled over, by the part of it at one speed.

    Parameters
    ----------
    scan : Scan
        The pass.
    settings : DepthSettings
        Depth range, and the parameters of `focus`.

    Raises
    ------
    RollerError
        If no part is at one speed, or shows no flat plate.
    """
    rolled = constant_speed_part(scan, _LEAST_LENGTH_M)
    points, _ = pass_points(rolled, settings)
    middle_ns = int(rolled.events.t_ns[len(rolled.events) // 2])
    return find_plate(points, scan.track.matrices([middle_ns])[0], scan.camera)
