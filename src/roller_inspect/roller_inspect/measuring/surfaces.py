"""Area, diameter, depth and volume of what a region holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from roller_inspect.height_map.height_map import Bools, HeightMap

from .datum import datum_plane
from .measured import Measured, not_measurable

#: Share of the region that must be known.
_LEAST_KNOWN = 0.8


@dataclass(frozen=True)
class Extent:
    """What stands out in a region."""

    #: Its extreme, + above the datum, − below, metres.
    depth: Measured
    #: Where it is more than half as high, square metres.
    area: Measured
    #: Of the circle with that area, metres.
    diameter: Measured
    #: Between it and the datum, signed, cubic metres.
    volume: Measured


def extent(height_map: HeightMap, region: Bools, datum: Bools) -> Extent:
    """Depth, area, diameter and volume of what stands out of a datum in a region.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    region, datum : ndarray of bool, shape (ny, nx)
        Where to look, and the cells of the datum plane.
    """
    plane = datum_plane(height_map, datum & ~region)
    known = region & height_map.known & np.isfinite(height_map.height_m)
    if plane is None or not region.any() or known.sum() < _LEAST_KNOWN * region.sum():
        reason = "too few measured cells in " + ("the datum" if plane is None else "the region")
        return Extent(*(not_measurable(unit, reason) for unit in ("m", "m²", "m", "m³")))
    step = height_map.step_m
    away = height_map.height_m - plane.at(height_map.x_m[None, :], height_map.y_m[:, None])
    flat = ndimage.median_filter(np.where(known, away, 0.0), 3)
    values = flat[known]
    sign = 1.0 if values.max() > -values.min() else -1.0
    depth = float((sign * values).max())
    sigma = float(np.median(height_map.sigma_m[known]))
    rows, columns = np.nonzero(known)
    x, y = float(height_map.x_m[columns].mean()), float(height_map.y_m[rows].mean())
    base = float(np.hypot(plane.standard_uncertainty(x, y), plane.common_m))
    u_depth = float(np.hypot(0.7 * sigma, base))
    area = float((known & (sign * flat > depth / 2)).sum()) * step**2
    gy, gx = np.gradient(flat, step)
    rim = known & (np.abs(sign * flat - depth / 2) < 0.25 * depth)
    slope = float(np.median(np.hypot(gx, gy)[rim])) if rim.any() else depth / step
    u_edge = float(np.hypot(u_depth / max(slope, 1e-3), step / np.sqrt(12)))
    diameter = 2 * float(np.sqrt(area / np.pi))
    u_area = np.pi * diameter * u_edge
    volume = float(away[known].sum()) * step**2 * float(region.sum() / known.sum())
    return Extent(
        Measured(sign * depth, 2 * u_depth, "m"),
        Measured(area, 2 * u_area, "m²"),
        Measured(diameter, 4 * u_edge, "m"),
        Measured(volume, 2 * float(region.sum()) * step**2 * base, "m³"),
    )
