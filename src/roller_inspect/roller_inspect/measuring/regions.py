"""Steps between regions, flushness and tilt of a fastener, what stands out of one, roughness."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_inspect.findings.cues import SCALES_M
from roller_inspect.findings.sizes import ALIKE_M, extreme
from roller_inspect.findings.smoothing import cell_weights, smoothed
from roller_inspect.height_map.gaps import WIDE_GAP_M, grown, inner_gaps
from roller_inspect.height_map.height_map import F32, Bools, HeightMap
from roller_inspect.references.nominal import fit_polynomial
from roller_inspect.references.reference import ReferenceError

from .datum import Datum, datum_plane
from .measured import STANDS_OUT, Measured, not_measurable

#: Cut-off of the S-filter, m: what is finer is the sensor's own; and the Gaussian's standard
#: deviation by its cut-off (ISO 16610-61).
_S_FILTER_M, _BY_CUT_OFF = 0.25e-3, 0.1874
#: Share of a region that must be measured for its roughness, and known for all else; Sq must be
#: so many times the noise.
_LEAST_MEASURED, _LEAST_KNOWN, _TIMES_NOISE = 0.3, 0.8, 3.0
#: A tilt of more standard uncertainties has a direction.
_BOTH = 4.0
#: Cells so near to a gap are beside it, and so much of a depth may be found there.
_BESIDE, _MOST_BESIDE = 3, 0.9
_FEW, _LITTLE = "too few measured cells in {}", "too little of the {} was measured"


def step_height(
    height_map: HeightMap, datum: Bools, top: Bools, whole: float | None = None
) -> Measured:
    """How much one region lies above another, along its normal, at the second one's centre.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    datum, top : ndarray of bool, shape (ny, nx)
        Cells of the datum and of what is measured.
    whole : float, optional
        Cells of what is measured with those beyond the map; without it there are none.
    """
    if _unknown(height_map, top, whole):
        return not_measurable("m", _LITTLE.format("region"))
    base, upper = datum_plane(height_map, datum), datum_plane(height_map, top)
    if base is None or upper is None:
        return not_measurable("m", _FEW.format("the datum" if base is None else "the region"))
    return _step(base, upper)


def _step(base: Datum, upper: Datum) -> Measured:
    x, y = upper.centre_m
    # Heights are along the map's z; the datum may lean.
    upright = float(base.normal[2])
    value = upright * float(upper.at(x, y) - base.at(x, y))
    own = base.standard_uncertainty(x, y), upper.standard_uncertainty(x, y)
    return Measured(value, 2 * upright * math.hypot(*own, base.common_m, upper.common_m), "m")


def flushness_and_tilt(
    height_map: HeightMap, head: Bools, around: Bools, whole: float | None = None
) -> tuple[Measured, Measured]:
    """Height of a fastener's middle above the surface, metres; angle between both, radians.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    head, around : ndarray of bool, shape (ny, nx)
        Cells of its head, and of the surface around.
    whole : float, optional
        Cells of the head with those beyond the map; without it there are none.
    """
    if _unknown(height_map, head, whole):
        reason = _LITTLE.format("head")
        return not_measurable("m", reason), not_measurable("rad", reason)
    base, top = datum_plane(height_map, around), datum_plane(height_map, head)
    if base is None or top is None:
        reason = _FEW.format("the surface around" if base is None else "the head")
        return not_measurable("m", reason), not_measurable("rad", reason)
    slope = np.array([top.slope_x - base.slope_x, top.slope_y - base.slope_y])
    size = float(np.hypot(*slope))
    along = slope / size if size > 0 else np.array([1.0, 0.0])
    both = (top.covariance + base.covariance)[1:, 1:]
    # What the head's errors have in common may be as much on one side as on the other, or not.
    across_m = 2 * height_map.step_m * math.sqrt(float(head.sum()) / math.pi)
    u = math.sqrt(max(float(along @ both @ along), 0.0) + 2 * (top.common_m / across_m) ** 2)
    # Of hardly any tilt both directions add up: 95 % of such errors lie within 2.45 times of one.
    k = 2.0 if size > _BOTH * u else 2.45
    return _step(base, top), Measured(_angle_between(base.normal, top.normal), k * u, "rad")


def _angle_between(a: F64, b: F64) -> float:
    """Angle between two directions, radians; of small ones to the last digit."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def extent(
    height_map: HeightMap, region: Bools, datum: Bools, whole: float | None = None
) -> dict[str, Measured]:
    """What stands out of a datum in a region.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    region, datum : ndarray of bool, shape (ny, nx)
        Where to look, and the cells of the datum plane.
    whole : float, optional
        Cells of the region with those beyond the map; without it there are none.

    Returns
    -------
    dict of Measured
        `depth`: its extreme, + above the datum, − below, m; `area`: where it is more than half as
        high, m²; `diameter` of the circle with that area, m; `volume` between it and the datum,
        signed, m³.
    """
    plane = datum_plane(height_map, datum & ~region)
    if plane is None or _unknown(height_map, region, whole):
        reason = _FEW.format("the datum") if plane is None else _LITTLE.format("region")
        missing = not_measurable("m", reason)
        return {
            "depth": missing, "area": not_measurable("m²", reason), "diameter": missing,
            "volume": not_measurable("m³", reason),
        }  # fmt: skip
    known = region & height_map.known & np.isfinite(height_map.height_m)
    step = height_map.step_m
    base_m = plane.at(height_map.x_m[None, :], height_map.y_m[:, None])
    away: F32 = (height_map.height_m - base_m).astype(np.float32)
    fine = smoothed(away, cell_weights(height_map, away), max(SCALES_M[0] / step, 0.5))[0]
    inside = known & np.isfinite(fine)
    rise, hollow = extreme(fine, away, inside), extreme(-fine, -away, inside)
    sign, depth = (1.0, rise) if rise > hollow else (-1.0, hollow)
    sigma = float(np.median(height_map.sigma_m[known]))
    rows, columns = np.nonzero(known)
    x, y = float(height_map.x_m[columns].mean()), float(height_map.y_m[rows].mean())
    base = float(np.hypot(plane.standard_uncertainty(x, y), plane.common_m))
    u_depth = float(np.hypot(0.7 * sigma, base))
    cells = whole or float(region.sum())
    whole_m2 = cells * step**2
    volume = float(away[known].sum()) * step**2 * cells / float(known.sum())
    # Neighbours share their errors: a small region's mean errs as its cells do.
    u_mean = math.hypot(base, sigma / math.sqrt(max(1.0, whole_m2 / ALIKE_M**2)))
    measured_volume = Measured(volume, 2 * whole_m2 * u_mean, "m³")
    if depth <= STANDS_OUT * u_depth:
        reason = "nothing stands out of the noise"
        return {
            "depth": Measured(sign * depth, STANDS_OUT * u_depth, "m"),
            "area": not_measurable("m²", reason), "diameter": not_measurable("m", reason),
            "volume": measured_volume,
        }  # fmt: skip
    gaps = inner_gaps(height_map, WIDE_GAP_M) & region
    if extreme(sign * fine, sign * away, inside & grown(gaps, _BESIDE)) > _MOST_BESIDE * depth:
        reason = "it is deepest or highest beside a gap: how far it goes on there wasn't measured"
        return {
            "depth": not_measurable("m", reason), "area": not_measurable("m²", reason),
            "diameter": not_measurable("m", reason), "volume": not_measurable("m³", reason),
        }  # fmt: skip
    flat = ndimage.median_filter(np.where(known, away, 0.0), 3)
    area = float((known & (sign * flat > depth / 2)).sum()) * step**2
    gy, gx = np.gradient(flat, step)
    rim = known & (np.abs(sign * flat - depth / 2) < 0.25 * depth)
    slope = float(np.median(np.hypot(gx, gy)[rim])) if rim.any() else depth / step
    u_edge = float(np.hypot(u_depth / max(slope, 1e-3), step / np.sqrt(12)))
    diameter = 2 * float(np.sqrt(area / np.pi))
    return {
        "depth": Measured(sign * depth, 2 * u_depth, "m"),
        "area": Measured(area, 2 * np.pi * diameter * u_edge, "m²"),
        "diameter": Measured(diameter, 4 * u_edge, "m"),
        "volume": measured_volume,
    }


def roughness(
    height_map: HeightMap, region: Bools, whole: float | None = None
) -> tuple[Measured, Measured]:
    """Sa and Sq of a region after form removal (a polynomial of order 2) and S-filter.

    "Not measurable" where it doesn't rise above the noise.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    region : ndarray of bool, shape (ny, nx)
        Cells.
    whole : float, optional
        Cells of the region with those beyond the map; without it there are none.
    """
    measured = region & height_map.measured()
    if _few(measured, region, whole, _LEAST_MEASURED):
        return _neither(_LITTLE.format("region"))
    rows, columns = np.nonzero(measured)
    x, y = height_map.x_m[columns], height_map.y_m[rows]
    try:
        form = fit_polynomial(x, y, height_map.height_m[rows, columns].astype(np.float64), 2)
    except ReferenceError:
        return _neither("too few measured cells")
    away = height_map.height_m - form(height_map.x_m[None, :], height_map.y_m[:, None])
    scale = _S_FILTER_M * _BY_CUT_OFF / height_map.step_m
    values = smoothed(away.astype(np.float32), measured.astype(np.float32), scale)[0][measured]
    noise = float(np.median(height_map.sigma_m[measured]))
    sq, sa = float(np.sqrt(np.mean(values**2))), float(np.mean(np.abs(values)))
    if sq <= _TIMES_NOISE * noise:
        return _neither(
            f"Sq {sq * 1e6:.0f} µm is not over {_TIMES_NOISE:g} × the noise of {noise * 1e6:.0f} µm"
        )
    # The noise adds to it in squares: all of it is uncertain.
    u = sq - float(np.sqrt(sq**2 - noise**2))
    return Measured(sa, 2 * u, "m"), Measured(sq, 2 * u, "m")


def _neither(reason: str) -> tuple[Measured, Measured]:
    return not_measurable("m", reason), not_measurable("m", reason)


def _unknown(height_map: HeightMap, region: Bools, whole: float | None) -> bool:
    """Whether too little of a region was measured or continued for its plane or its extent."""
    known = region & height_map.known & np.isfinite(height_map.height_m)
    return _few(known, region, whole, _LEAST_KNOWN)


def _few(cells: Bools, region: Bools, whole: float | None, least: float) -> bool:
    return not region.any() or bool(cells.sum() < least * (whole or region.sum()))
