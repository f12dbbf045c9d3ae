"""The frame of a height map: x along the scan, z out of the surface."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64

#: A surface that leans less than this is mapped along base's z.
_SNAP_RAD = np.radians(10.0)
#: A surface's own normal counts if of so many points this share lie so near to a plane, m, and
#: spread over it so far, m; else it is base's z.
_LEAST_POINTS, _SHARE, _FLAT_M, _WIDE_M = 1000, 0.8, 3e-4, 2e-3
#: It is told by so many at most.
_ENOUGH = 20_000


def find_frame(points_m: F64, motion: F64, surface_z_m: float) -> F64:
    """Frame of a map from the first points of a scan.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
        Points in base, metres.
    motion : ndarray, shape (3,)
        Direction in which they came; zero where it isn't known.
    surface_z_m : float
        Height of the nominal surface in base, metres: zero of the map's heights.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        base_from_map; its z points up in base, as the roller comes from above.
    """
    normal = np.array([0.0, 0.0, 1.0])
    # A part of many says as much.
    points_m = points_m[:: 1 + len(points_m) // _ENOUGH]
    middle = np.median(points_m, axis=0) if len(points_m) else np.zeros(3)
    found = _plane_normal(points_m - middle) if len(points_m) >= _LEAST_POINTS else None
    if found is not None and np.arccos(np.clip(found[2], -1.0, 1.0)) > _SNAP_RAD:
        normal = found
    # Parallel to base, along the axis that is nearest to the motion.
    axis = np.eye(3)[1 if abs(motion[1]) > abs(motion[0]) else 0]
    along = axis - (axis @ normal) * normal
    along /= np.linalg.norm(along)
    frame = np.eye(4)
    frame[:3, :3] = np.stack([along, np.cross(normal, along), normal], axis=1)
    # The origin lies under base's own, so that cells of scans of one part fall together.
    frame[2, 3] = surface_z_m
    if normal[2] < 1.0:
        frame[:3, 3] = middle
    return frame


def _plane_normal(spread: F64) -> F64 | None:
    """Normal of the plane that most points lie in, upwards; None unless they clearly do."""
    inner = spread
    for _ in range(5):
        found = np.linalg.eigh(inner.T @ inner)[1][:, 0]
        away = np.abs(spread @ found)
        inner = spread[away <= _FLAT_M]
        if len(inner) < _SHARE * len(spread):
            return None
    if np.linalg.eigvalsh(inner.T @ inner)[1] < _WIDE_M**2 * len(inner):
        return None
    return np.asarray(found * np.sign(found[2] or 1.0))
