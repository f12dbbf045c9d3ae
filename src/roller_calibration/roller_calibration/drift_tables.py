"""What the model of drift leaves over, by slope, and how wide the gauges' bands of events are."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import SLOPE_BINS

from .drift_lines import GaugeLines

#: Fewest lines of a bin of slopes whose residual is its own, also as a share of all of a polarity
#: and direction: on walls that all have one slope fewer are strays. Least residual, m.
_LEAST_IN_BIN, _LEAST_SHARE, LEAST_RESIDUAL_M = 15, 0.03, 5e-6
#: By how much what 95 % lie within may widen the deviation that 68 % lie within.
_TAILS = 1.5
#: Share of the lines of the gauges that are no wider than what counts as the widest, and whose
#: contrast changes no faster than what counts as the fastest.
_WIDEST = 0.98


def residual_table(lines: GaugeLines, rest: F64, unsure: F64, most: float, unknown_m: float) -> F64:
    """What is left, as a standard deviation, shape (4, bins): OFF rising, OFF falling, ON.

    Parameters
    ----------
    lines : GaugeLines
        Lines.
    rest : ndarray of float64, shape (n,)
        What the model leaves of their errors, m.
    unsure : ndarray of float64, shape (n,)
        What the gauges don't fix of the model, m.
    most : float
        Steepest slope.
    unknown_m : float
        Of what no gauge shows.
    """
    kinds = [
        _residuals(
            rest[which], lines.sigma_m[which], unsure[which], lines.slope[which],
            lines.polarity[which], most,
        )
        for which in (lines.of_sphere, ~lines.of_sphere)
    ]  # fmt: skip
    # What one kind of gauge leaves the other may not know of.
    return np.array([_filled(row, unknown_m) for row in np.fmax(*kinds).reshape(4, -1)])


def _residuals(rest: F64, sigma: F64, unsure: F64, slope: F64, polarity: F64, most: float) -> F64:
    """What is left, as a standard deviation, by polarity, direction and bin of slopes.

    What the fits of the lines themselves err by is taken out.
    """
    table = np.full((2, 2, SLOPE_BINS), np.nan)
    bins = np.minimum((np.abs(slope) / most * SLOPE_BINS).astype(int), SLOPE_BINS - 1)
    for p in range(2):
        for falling in range(2):
            kind = (polarity == p) & ((slope < 0) == bool(falling))
            least = max(_LEAST_IN_BIN, _LEAST_SHARE * kind.sum())
            for b in range(SLOPE_BINS):
                here = kind & (bins == b)
                if here.sum() >= least:
                    # 68 % lie within one deviation and 95 % within two; more tells of strays.
                    one, two = np.quantile(np.abs(rest[here]), (0.683, 0.95))
                    spread = min(max(one, two / 2), _TAILS * one) ** 2
                    drift = max(spread - np.median(sigma[here]) ** 2, LEAST_RESIDUAL_M**2)
                    table[p, falling, b] = np.sqrt(drift + np.median(unsure[here]) ** 2)
    return table


def _filled(row: F64, unknown_m: float) -> F64:
    """The table with slopes that no gauge shows: as drift is before it is measured."""
    known = np.flatnonzero(np.isfinite(row))
    if not len(known):
        return np.full(len(row), unknown_m)
    return np.interp(np.arange(len(row)), known, row[known])


def band_widths(lines: GaugeLines) -> list[float]:
    """Median and widest band of events by polarity, rising and falling; 0 where unknown."""
    found, seen = [], lines.on_slope & (lines.width_m > 0)
    for polarity in (0, 1):
        for falling in (False, True):
            own = (lines.polarity == polarity) & ((lines.slope < 0) == falling)
            width = lines.width_m[own & seen]
            enough = len(width) >= _LEAST_IN_BIN
            found += [*np.quantile(width, (0.5, _WIDEST))] if enough else [0.0, 0.0]
    return [float(v) for v in found]


def most_changes(lines: GaugeLines) -> list[float]:
    """Fastest change of contrast on slopes, of OFF and of ON events; 0 where unknown."""
    found = []
    for polarity in (0, 1):
        change = np.abs(lines.change[lines.on_slope & (lines.polarity == polarity)])
        enough = len(change) >= _LEAST_IN_BIN
        found.append(round(float(np.quantile(change, _WIDEST)), 3) if enough else 0.0)
    return found
