"""The drift of edges from gauges: what their lines are too high by, fitted by polarity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import (
    SLOPE_BINS,
    TERMS,
    EdgeDriftSettings,
    drift_terms,
    share_of_travel,
)

from .gauges import LEAST_LINES, Gauge
from .pass_lines import WALL_SLOPE, EdgeDriftError

#: Spread of the coefficients before anything was measured, m.
_PRIOR_M = 1.5e-4
#: Spread of what lifts all edges of a sphere more than walls, m.
_LEVEL_M = 1e-3
#: Share of the median error from which on a polarity's correction is left out, and of its spread
#: that stands for none. On the virtual cell's gauges OFF leaves 0.78-0.81, ON 0.89-0.99.
_HELPS, _NOTHING = 0.85, 1e-3
#: Share of the lines on slopes whose own slope has the right sign, from which on slopes count.
_HOLDS = 0.75
#: Terms: of slopes, what lifts all edges alike, of the side that walls face.
_SLOPE, _EVEN, _SIDE = 1, 2, 3
#: How surely the change of contrast tells which way walls rise where light stands still, and from
#: where on it travels.
_SIDED = 0.5, 0.8
#: How clear the change of contrast is on walls that all do alike. Light that stands still 0.3-0.4.
_CLEAR = 0.42
#: By how much the fit has to be better, a gauge, for what lifts all edges alike; else it is none.
#: On the virtual cell's gauges -26 µm would gain 2.7, and other objects err 4 µm more with it. And
#: for a polarity that spheres don't show: OFF gains 20 in the light `strong`, ON 1 in the ring.
#: A gauge of steps, where contrast changes alike on all walls: there it is to be expected.
_GAINS, _GAINS_ALIKE = 5.0, 2.0
#: Deviation from which on lines count less, m, in deviations, and rounds of that.
_HUBER_M, _HUBER, _ROUNDS = 6e-5, 1.5, 20
#: Fewest lines of a bin of slopes whose residual is its own, and least residual, m.
_LEAST_IN_BIN, _LEAST_RESIDUAL_M = 15, 5e-6


@dataclass(frozen=True)
class EdgeDrift:
    """What was found."""

    #: The drift.
    settings: EdgeDriftSettings
    #: Median absolute error of the lines of OFF and of ON events, without the correction and with
    #: it, metres; of what no gauge tells, what drift may be before it is measured.
    before_m: tuple[float, float]
    after_m: tuple[float, float]
    #: Whether OFF and ON events are corrected at all.
    corrected: tuple[bool, bool]

    @property
    def left_on_slopes_m(self) -> float:
        """Height by which lines are off with the correction, on a slope of 1, metres."""
        return float(f"{sum(self.after_m) / self.settings.max_slope:.3g}")


def fit_drift(gauges: list[Gauge]) -> EdgeDrift:
    """Fit the drift of each polarity to the gauges.

    Least squares with what is unknown of the gauges, ridge and Huber's weights.

    Raises
    ------
    EdgeDriftError
        If too few lines lie on slopes.
    """
    lines = [gauge.lines for gauge in gauges]
    slope, change, side, polarity, sigma = (
        np.concatenate([getattr(own, name) for own in lines])
        for name in ("slope", "change", "side", "polarity", "sigma_m")
    )
    error = np.concatenate([gauge.error_m for gauge in gauges])
    on_slope = np.abs(np.concatenate([gauge.rise for gauge in gauges])) > WALL_SLOPE
    if on_slope.sum() < LEAST_LINES:
        raise EdgeDriftError(f"{int(on_slope.sum())} lines on slopes, fewer than {LEAST_LINES}")
    terms = drift_terms(slope, change, side)
    # Where events lie evenly over the crossing, whichever way a wall rises, the light stands still:
    # then there is no drift, and what the gauges are off by is where on a wall events arise.
    # A gauge of whose walls each pixel has one event doesn't tell.
    shares = [share_of_travel(g.travel) for g in gauges]
    sided, clear = _sided(gauges)
    travels = max(*shares, float(np.interp(sided, _SIDED, (0, 1))), 1e-3)
    # Where contrast changes alike whichever way walls rise, all are lifted alike, whatever slope is
    # found; of that spheres say nothing.
    alike = sided < _SIDED[0] and clear > _CLEAR
    if alike:
        terms[:, _EVEN] = 1.0
    columns = [np.where((polarity == k)[:, None], terms, 0.0) for k in (0, 1)]
    spreads = [np.full(TERMS, travels * _PRIOR_M) for _ in range(2)]
    own_level = [False] * 2 * TERMS
    for k, gauge in enumerate(gauges):
        start = sum(len(g.error_m) for g in gauges[:k])
        here = slice(start, start + len(gauge.error_m))
        unknowns, spread = gauge.unknown, gauge.spread
        if gauge.sphere:
            # On a dome, which bends little, edges drift further than on walls, most on one side.
            levels = [np.where(gauge.lines.polarity == p, terms[here, _EVEN], 0.0) for p in (0, 1)]
            unknowns, spread = (
                np.column_stack([unknowns, *levels]),
                np.append(spread, [_LEVEL_M] * 2),
            )
        column = np.zeros((len(error), len(spread)))
        column[here] = unknowns
        columns.append(column)
        spreads.append(spread)
        own_level += [False] * gauge.unknown.shape[1]
        own_level += [True] * (len(spread) - gauge.unknown.shape[1])
    design = np.concatenate(columns, axis=1)
    # A gauge counts as a whole as much as the other: neighbouring lines share what they err by.
    share = np.concatenate([np.full(len(g.error_m), LEAST_LINES / len(g.error_m)) for g in gauges])
    noise = np.hypot(sigma, _HUBER_M)
    spheres = np.repeat([g.sphere for g in gauges], [len(g.error_m) for g in gauges])
    steps = sum(not gauge.sphere for gauge in gauges)
    least = _GAINS_ALIKE * steps if alike else _GAINS * len(gauges)
    if alike:
        walls = [on_slope & ~spheres & (polarity == k) for k in range(2)]
        used = np.arange(TERMS) == _EVEN
        for k in range(2):
            spreads[k] = spreads[k] * np.where(used & (walls[k].sum() >= LEAST_LINES), 1, _NOTHING)
    else:
        # Slopes tell which way a wall rises as long as drift leaves them standing; else the side.
        either = [
            [*(own * np.where(np.arange(TERMS) == unused, _NOTHING, 1.0) for own in spreads[:2])]
            + spreads[2:]
            for unused in (_SIDE, _SLOPE)
        ]
        costs = [_cost(design, error, each, share, noise) for each in either]
        gains = costs[0] - costs[1] > least
        spreads = either[gains or not all(_slopes_hold(g) for g in gauges)]
    # What hardly helps on the spheres themselves, nor explains the steps, is chance and would do
    # harm elsewhere.
    on_spheres = on_slope & spheres
    full = _solve(design, error, spreads, share, noise)[1]
    every = spreads[:2]
    for k in range(2):
        none = [*every[:k], every[k] * _NOTHING, *every[k + 1 :], *spreads[2:]]
        without = _solve(design, error, none, share, noise)[1]
        own = on_spheres & (polarity == k)
        if own.any() and np.median(np.abs(full[own])) > _HELPS * np.median(np.abs(without[own])):
            whole = [*every, *spreads[2:]]
            costs = [_cost(design, error, each, share, noise) for each in (none, whole)]
            if costs[0] - costs[1] < least:
                spreads[k] = every[k] * _NOTHING
    for k in range(2):
        level = spreads[k] * np.where(np.arange(TERMS) == _EVEN, _NOTHING, 1.0)
        less = [*spreads[:k], level, *spreads[k + 1 :]]
        costs = [_cost(design, error, each, share, noise) for each in (less, spreads)]
        if costs[0] - costs[1] < least:
            spreads = less
    beta, rest, normal = _solve(design, error, spreads, share, noise)
    rest += np.where(own_level, design, 0.0) @ beta
    unknown = np.where(own_level, 0.0, design)[:, 2 * TERMS :] @ beta[2 * TERMS :]
    most = float(np.quantile(np.abs(slope[on_slope]), 0.98))
    # What neither gauge fixes of the coefficients is uncertain too.
    own = design[:, : 2 * TERMS]
    covariance = np.linalg.inv(normal)[: 2 * TERMS, : 2 * TERMS]
    unsure = np.sqrt(np.einsum("ij,jk,ik->i", own, covariance, own))
    kinds = [
        _residuals(rest[own], sigma[own], unsure[own], slope[own], polarity[own], most)
        for own in (spheres, ~spheres)
    ]
    # What one kind of gauge leaves the other may not know of.
    table = np.array([_filled(row) for row in np.fmax(*kinds).reshape(4, -1)])
    found = beta[: 2 * TERMS].reshape(2, TERMS)
    settings = EdgeDriftSettings.create(
        {
            # To 0.1 µm; no zero with a sign.
            "coefficients_m": [round(float(v), 7) + 0.0 for v in found[:, :2].ravel()],
            "even_m": [round(float(v), 7) + 0.0 for v in found[:, _EVEN]],
            "side_m": [round(float(v), 7) + 0.0 for v in found[:, _SIDE]],
            "residual_m": [float(f"{v:.3g}") for v in table.ravel()],
            "max_slope": round(most, 3),
        }
    )
    off, on = (on_slope & (polarity == k) for k in (0, 1))
    plain = np.abs(error - unknown)
    before = _median(plain[off]), _median(plain[on])
    after = _median(np.abs(rest[off])), _median(np.abs(rest[on]))
    off, on = (bool(np.abs(own).max() >= _LEAST_RESIDUAL_M) for own in found)
    return EdgeDrift(settings, before, after, (off, on))


def _sided(gauges: list[Gauge]) -> tuple[float, float]:
    """How surely the change of contrast tells which way a wall rises: 0 not at all, 1 always.

    And how clear that change is: 0 if there is none, 1 at most.
    """
    sums = np.zeros(2)
    for gauge in gauges:
        own = np.abs(gauge.rise) > WALL_SLOPE
        side = gauge.lines.side[own]
        sums += np.array([side @ np.sign(gauge.rise[own]), np.abs(side).sum()]) / max(len(side), 1)
    return float(abs(sums[0]) / max(sums[1], 1e-9)), float(sums[1] / len(gauges))


def _slopes_hold(gauge: Gauge) -> bool:
    """Whether what is found on a gauge rises where it does; large drift turns slopes over."""
    own = np.abs(gauge.rise) > WALL_SLOPE
    return (
        bool(np.mean(gauge.lines.slope[own] * gauge.rise[own] > 0) > _HOLDS) if own.any() else True
    )


def _solve(
    design: F64, error: F64, spreads: list[F64], share: F64, noise: F64
) -> tuple[F64, F64, F64]:
    """Robust ridge: coefficients, what they leave over, and the normal matrix."""
    prior, weight = np.diag(1 / np.concatenate(spreads) ** 2), np.ones(len(error))
    for _ in range(_ROUNDS):
        w = weight * share / noise**2
        normal = (design * w[:, None]).T @ design + prior
        beta = np.linalg.solve(normal, design.T @ (w * error))
        rest = error - design @ beta
        weight = np.minimum(1.0, _HUBER * noise / np.maximum(np.abs(rest), 1e-9))
    return np.asarray(beta, np.float64), rest, normal


def _cost(design: F64, error: F64, spreads: list[F64], share: F64, noise: F64) -> float:
    """What `_solve` makes least."""
    beta, rest, _ = _solve(design, error, spreads, share, noise)
    off = np.abs(rest) / noise
    lost = np.where(off < _HUBER, off**2, 2 * _HUBER * off - _HUBER**2)
    return float(share @ lost + np.sum((beta / np.concatenate(spreads)) ** 2))


def _median(values: F64) -> float:
    return float(np.median(values)) if len(values) else _PRIOR_M


def _residuals(rest: F64, sigma: F64, unsure: F64, slope: F64, polarity: F64, most: float) -> F64:
    """What is left, as a standard deviation, by polarity, direction and bin of slopes.

    What the fits of the lines themselves err by is taken out.
    """
    table = np.full((2, 2, SLOPE_BINS), np.nan)
    bins = np.minimum((np.abs(slope) / most * SLOPE_BINS).astype(int), SLOPE_BINS - 1)
    for p in range(2):
        for falling in range(2):
            kind = (polarity == p) & ((slope < 0) == bool(falling))
            for b in range(SLOPE_BINS):
                here = kind & (bins == b)
                if here.sum() >= _LEAST_IN_BIN:
                    # 68 % lie within one deviation, whatever the tails.
                    spread = np.quantile(np.abs(rest[here]), 0.683) ** 2
                    drift = max(spread - np.median(sigma[here]) ** 2, _LEAST_RESIDUAL_M**2)
                    table[p, falling, b] = np.sqrt(drift + np.median(unsure[here]) ** 2)
    return table


def _filled(row: F64) -> F64:
    """The table with slopes that no gauge shows: as drift is before it is measured."""
    known = np.flatnonzero(np.isfinite(row))
    if not len(known):
        return np.full(len(row), _PRIOR_M)
    return np.interp(np.arange(len(row)), known, row[known])
