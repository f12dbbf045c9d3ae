"""The frame of a height map: x along the scan, z out of the surface."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64

#: Directions nearer than this to an axis of base are that axis: maps of parts that lie straight
#: are parallel to base.
_SNAP_RAD = np.radians(10.0)


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
    middle = np.median(points_m, axis=0) if len(points_m) else np.zeros(3)
    spread = points_m - middle
    if len(points_m) >= 100:
        for _ in range(3):  # the plane of the inner part
            found = np.linalg.svd(spread, full_matrices=False)[2][2]
            away = np.abs(spread @ found)
            spread = spread[away <= max(2.0 * float(np.median(away)), 1e-9)]
        found = found * np.sign(found[2] or 1.0)
        if np.arccos(np.clip(found[2], -1.0, 1.0)) > _SNAP_RAD:
            normal = found
    along = motion - (motion @ normal) * normal
    straight = [axis - (axis @ normal) * normal for axis in np.eye(3)[:2]]
    if np.linalg.norm(along) < 1e-9:
        along = straight[0]
    along = along / np.linalg.norm(along)
    for axis in straight:
        axis = axis / np.linalg.norm(axis)
        if abs(along @ axis) > np.cos(_SNAP_RAD):
            along = axis
    if along[int(np.argmax(np.abs(along)))] < 0:
        along = -along
    frame = np.eye(4)
    frame[:3, :3] = np.stack([along, np.cross(normal, along), normal], axis=1)
    # The origin lies under base's own, so that cells of scans of one part fall together.
    frame[2, 3] = surface_z_m
    if normal[2] < 1.0:
        frame[:3, 3] = middle
    return frame
