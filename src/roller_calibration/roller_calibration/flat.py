"""Depth range from a rolling pass over a flat plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.transforms import F64

from .dome_candidates import cell_medians

#: Fewest points, and edge of the cells whose heights are compared, metres.
LEAST_POINTS, CELL_M = 200, 5e-4
_LEAST_CELLS = 30
#: A plate is flat if this share of the cells lies within that distance of a plane, metres.
FLAT_M, _FLAT_SHARE = 1.5e-4, 0.85
#: The most that a plane may lean against the image, degrees.
MOST_TILT_DEG = 5.0
#: The cells must reach this far in both directions, metres.
_LEAST_REACH_M = 3e-3
_ROUNDS = 6


class FlatError(RollerError):
    """A pass over something from which the depth of a flat plate can't be found."""


@dataclass(frozen=True)
class FlatPlate:
    """A plate as the camera sees it."""

    #: On the camera's axis, metres.
    depth_m: float
    #: Over the image, metres.
    nearest_m: float
    farthest_m: float
    #: How far it falls away to the right (u) and downwards (v), degrees.
    tilt_deg: tuple[float, float]
    #: Median distance of the cells from the plane, metres.
    scatter_m: float
    #: Cells that lie on the plane.
    share: float
    #: Depths that counted.
    points: int

    def depth_range_m(self, reach_m: float, margin_m: float) -> tuple[float, float]:
        """Nearest and farthest depth to search.

        Parameters
        ----------
        reach_m : float
            How far relief stands out of a plate, or sinks into it.
        margin_m : float
            Beyond that, to either side.
        """
        return self.nearest_m - reach_m - margin_m, self.farthest_m + reach_m + margin_m


def find_plate(points_m: F64, pose: F64, camera: Camera) -> FlatPlate:
    """Find the plane of a flat plate.

    Parameters
    ----------
    points_m : ndarray of float64, shape (n, 3)
        Points of all depth maps of the pass in base, metres.
    pose : ndarray of float64, shape (4, 4)
        A camera of the pass in base.
    camera : Camera
        Intrinsics.

    Raises
    ------
    FlatError
        Saying what is there instead.
    """
    if len(points_m) < LEAST_POINTS:
        raise FlatError(
            f"{len(points_m)} depths, fewer than {LEAST_POINTS}: too few events; a plate needs "
            "texture, and a skin alone shows little of it"
        )
    local = (points_m - pose[:3, 3]) @ pose[:3, :3]
    cells = cell_medians(local, CELL_M)
    low, high = np.percentile(cells[:, :2], [5, 95], axis=0)
    if len(cells) < _LEAST_CELLS or (high - low).min() < _LEAST_REACH_M:
        raise FlatError(
            f"depths over {(high - low)[0] * 1e3:.1f} × {(high - low)[1] * 1e3:.1f} mm alone: too "
            "little of the plate to find a plane"
        )
    design = np.column_stack([np.ones(len(cells)), cells[:, :2]])
    weight = np.ones(len(cells))
    for _ in range(_ROUNDS):
        plane = np.linalg.lstsq(design * weight[:, None], cells[:, 2] * weight, rcond=None)[0]
        miss = np.abs(cells[:, 2] - design @ plane)
        weight = np.sqrt(1 / np.maximum(miss / (0.3 * FLAT_M), 1))
    share = float((miss < FLAT_M).mean())
    if share < _FLAT_SHARE:
        raise FlatError(
            f"not flat: {share:.0%} of the surface lies within {FLAT_M * 1e6:.0f} µm of a plane, "
            f"less than {_FLAT_SHARE:.0%}; roll over a flat plate without relief"
        )
    tilt = (float(np.degrees(np.arctan(plane[1]))), float(np.degrees(np.arctan(plane[2]))))
    if max(map(abs, tilt)) > MOST_TILT_DEG:
        raise FlatError(
            f"the plate leans by {tilt[0]:.1f}° along the image's rows and {tilt[1]:.1f}° along "
            f"its columns, more than {MOST_TILT_DEG:g}°: check the camera's place on the tool"
        )
    u, v = np.meshgrid([0.0, camera.width - 1.0], [0.0, camera.height - 1.0])
    rays = camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2))
    # z = a + b·x·z + c·y·z along a ray (x, y, 1).
    corners = plane[0] / (1 - rays[:, :2] @ plane[1:])
    return FlatPlate(
        float(plane[0]),
        float(corners.min()),
        float(corners.max()),
        tilt,
        float(np.median(miss)),
        share,
        len(points_m),
    )
