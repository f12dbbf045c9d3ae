"""Areal roughness, where it can be measured at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_inspect.findings.cues import smoothed
from roller_inspect.height_map.height_map import MEASURED, Bools, HeightMap
from roller_inspect.references.nominal import fit_polynomial
from roller_inspect.references.reference import ReferenceError

from .measured import Measured, not_measurable

#: Cut-off of the S-filter, m, and the Gaussian's standard deviation by its cut-off (ISO 16610-61).
S_FILTER_M, _BY_CUT_OFF = 0.25e-3, 0.1874
#: Share of the region that must be measured; Sq must be so many times the noise.
_LEAST_MEASURED, _TIMES_NOISE = 0.3, 3.0


@dataclass(frozen=True)
class Roughness:
    """Sa and Sq of a region after form removal (a polynomial of order 2) and S-filter."""

    sa: Measured
    sq: Measured


def roughness(height_map: HeightMap, region: Bools, s_filter_m: float = S_FILTER_M) -> Roughness:
    """Roughness of a region; "not measurable" where it doesn't rise above the noise.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    region : ndarray of bool, shape (ny, nx)
        Cells.
    s_filter_m : float
        Cut-off of the S-filter, metres, at least 0.25 mm: what is finer is the sensor's own.
    """
    measured = region & (height_map.state == MEASURED) & np.isfinite(height_map.height_m)
    if not region.any() or measured.sum() < _LEAST_MEASURED * region.sum():
        return _none("too little of the region was measured")
    step = height_map.step_m
    rows, columns = np.nonzero(measured)
    try:
        form = fit_polynomial(
            height_map.x_m[columns],
            height_map.y_m[rows],
            height_map.height_m[rows, columns].astype(np.float64),
            2,
        )
    except ReferenceError:
        return _none("too few measured cells")
    away = height_map.height_m - form(height_map.x_m[None, :], height_map.y_m[:, None])
    scale = max(s_filter_m, S_FILTER_M) * _BY_CUT_OFF / step
    values = smoothed(away.astype(np.float32), measured.astype(np.float32), scale)[0][measured]
    noise = float(np.median(height_map.sigma_m[measured]))
    sq, sa = float(np.sqrt(np.mean(values**2))), float(np.mean(np.abs(values)))
    if sq <= _TIMES_NOISE * noise:
        return _none(
            f"Sq {sq * 1e6:.0f} µm is not over {_TIMES_NOISE:g} × the noise of {noise * 1e6:.0f} µm"
        )
    # The noise adds to it in squares: all of it is uncertain.
    u = sq - float(np.sqrt(sq**2 - noise**2))
    return Roughness(Measured(sa, 2 * u, "m"), Measured(sq, 2 * u, "m"))


def _none(reason: str) -> Roughness:
    return Roughness(not_measurable("m", reason), not_measurable("m", reason))
