"""The drift of edges from gauges: what their lines are too high by, fitted by polarity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import (
    TERMS,
    EdgeDriftSettings,
    drift_terms,
    facing,
)
from roller_emvs.lines.travelling_light import share_of_travel

from .drift_lines import GaugeLines
from .drift_speed import find_speed_drift
from .drift_system import HUBER_M, DriftSystem
from .drift_tables import LEAST_RESIDUAL_M, band_widths, most_changes, residual_table
from .gauge import LEAST_LINES, Gauge
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
#: Share of the lines whose slope drift turns over that are no steeper than what it turns over.
_TURNED = 0.95
#: Spreads of where on a wall edges arise up to which that explains what walls of a kind are off by.
#: Virtual ring and dome: up to 1.8; light whose drift nothing tells: 2.2 to 3.1.
_PLACED = 2.0
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


@dataclass(frozen=True)
class _Light:
    """What the gauges show of the light."""

    #: How far drift may go, as a share of what it may be in light that travels.
    travels: float
    #: Whether contrast changes alike whichever way walls rise.
    alike: bool

    @classmethod
    def of(cls, gauges: list[Gauge]) -> _Light:
        # Where events lie evenly over the crossing, whichever way a wall rises, the light stands
        # still: then there is no drift, and what the gauges are off by is where on a wall events
        # arise. A gauge of whose walls each pixel has one event doesn't tell.
        shares = [share_of_travel(gauge.travel) for gauge in gauges]
        sided, clear = _sided(gauges)
        travels = max(*shares, float(np.interp(sided, _SIDED, (0, 1))), 1e-3)
        return cls(travels, sided < _SIDED[0] and clear > _CLEAR)


def fit_drift(gauges: list[Gauge]) -> EdgeDrift:
    """Fit the drift of each polarity to the gauges.

    Least squares with what is unknown of the gauges, ridge and Huber's weights.

    Raises
    ------
    EdgeDriftError
        If too few lines lie on slopes.
    """
    lines, light = GaugeLines.of(gauges), _Light.of(gauges)
    if lines.on_slope.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{int(lines.on_slope.sum())} lines on slopes, fewer than {LEAST_LINES}"
        )
    terms = drift_terms(lines.slope, lines.change, lines.side)
    if light.alike:
        # Then all walls are lifted alike, whatever slope is found; of that spheres say nothing.
        terms[:, _EVEN] = 1.0
    system, spreads = _system(gauges, lines, terms, light)
    spreads = _useful(system, spreads, gauges, lines, light)
    sure = 0.0
    if any(_leading(own) == _SIDE for own in spreads[:2]):
        sure = sure_slope(lines)
        terms[:, _SIDE] = facing(lines.side, lines.slope, sure)
        system, _ = _system(gauges, lines, terms, light)
    leading = [_leading(own) for own in spreads[:2]]
    speed = find_speed_drift(system, spreads, gauges, lines, terms, leading)
    system = replace(system, error=system.error - speed.height_m)
    beta, rest, normal = system.solve(spreads)
    # Where on a wall edges arise explains so much; what goes beyond is drift that nothing tells.
    placed = np.abs(beta) <= _PLACED * np.concatenate(spreads)
    untold = system.own_level | (system.on_wall & ~placed)
    rest += np.where(untold, system.design, 0.0) @ beta
    most = float(np.quantile(np.abs(lines.slope[lines.on_slope]), 0.98))
    # What neither gauge fixes of the coefficients is uncertain too.
    own = system.design[:, : 2 * TERMS]
    covariance = np.linalg.inv(normal)[: 2 * TERMS, : 2 * TERMS]
    unsure = np.sqrt(np.einsum("ij,jk,ik->i", own, covariance, own) + speed.unsure_m**2)
    table = residual_table(lines, rest, unsure, most, _PRIOR_M)
    found = beta[: 2 * TERMS].reshape(2, TERMS)
    settings = EdgeDriftSettings.create(
        {
            # To 0.1 µm; no zero with a sign.
            "coefficients_m": [round(float(v), 7) + 0.0 for v in found[:, :2].ravel()],
            "even_m": [round(float(v), 7) + 0.0 for v in found[:, _EVEN]],
            "side_m": [round(float(v), 7) + 0.0 for v in found[:, _SIDE]],
            "sure_slope": sure,
            "by_speed_s": [round(float(v), 7) + 0.0 for v in speed.by_speed_s.ravel()],
            "most_change": most_changes(lines),
            "speeds_m_s": speed.speeds_m_s,
            "residual_m": [float(f"{v:.3g}") for v in table.ravel()],
            "max_slope": round(most, 3),
            "widths_m": [float(f"{v:.3g}") for v in band_widths(lines)],
        }
    )
    of_gauges = np.where(untold, 0.0, system.design)[:, 2 * TERMS :] @ beta[2 * TERMS :]
    off, on = (lines.on_slope & (lines.polarity == k) for k in (0, 1))
    plain, left = np.abs(lines.error_m - of_gauges), np.abs(rest)
    corrected = tuple(bool(np.abs(own).max() >= LEAST_RESIDUAL_M) for own in found)
    return EdgeDrift(
        settings,
        (_median(plain[off]), _median(plain[on])),
        (_median(left[off]), _median(left[on])),
        (corrected[0], corrected[1]),
    )


def _system(
    gauges: list[Gauge], lines: GaugeLines, terms: F64, light: _Light
) -> tuple[DriftSystem, list[F64]]:
    """Errors as sums of drift, by polarity, and of what is unknown of gauges; spreads of these."""
    columns = [np.where((lines.polarity == k)[:, None], terms, 0.0) for k in (0, 1)]
    spreads = [np.full(TERMS, light.travels * _PRIOR_M) for _ in range(2)]
    own_level, on_wall = ([False] * 2 * TERMS for _ in range(2))
    ends = np.cumsum([len(gauge.error_m) for gauge in gauges])
    for gauge, end in zip(gauges, ends, strict=True):
        here = slice(end - len(gauge.error_m), end)
        unknowns, spread = gauge.unknown, gauge.spread
        if gauge.sphere:
            # On a dome, which bends little, edges drift further than on walls, most on one side.
            levels = [np.where(gauge.lines.polarity == p, terms[here, _EVEN], 0.0) for p in (0, 1)]
            unknowns = np.column_stack([unknowns, *levels])
            spread = np.append(spread, [_LEVEL_M] * 2)
        column = np.zeros((len(lines.error_m), len(spread)))
        column[here] = unknowns
        columns.append(column)
        spreads.append(spread)
        known = gauge.unknown.shape[1]
        own_level += [False] * known + [True] * (len(spread) - known)
        # The first unknown of steps is the height of all.
        on_wall += [not gauge.sphere and k > 0 for k in range(len(spread))]
    # A gauge counts as a whole as much as the other: neighbouring lines share what they err by.
    share = np.concatenate([np.full(len(g.error_m), LEAST_LINES / len(g.error_m)) for g in gauges])
    system = DriftSystem(
        np.concatenate(columns, axis=1), lines.error_m, share,
        np.hypot(lines.sigma_m, HUBER_M), np.array(own_level), np.array(on_wall),
    )  # fmt: skip
    return system, spreads


def _useful(
    system: DriftSystem, spreads: list[F64], gauges: list[Gauge], lines: GaugeLines, light: _Light
) -> list[F64]:
    """The spreads, those of terms that the gauges don't ask for next to nothing."""
    steps = sum(not gauge.sphere for gauge in gauges)
    least = _GAINS_ALIKE * steps if light.alike else _GAINS * len(gauges)
    if light.alike:
        spreads = _even_alone(spreads, lines)
    else:
        # Slopes tell which way a wall rises as long as drift leaves them standing; else the side.
        by_slope, by_side = (
            [*(_without(own, unused) for own in spreads[:2]), *spreads[2:]]
            for unused in (_SIDE, _SLOPE)
        )
        gains = system.cost(by_slope) - system.cost(by_side) > least
        holds = all(_slopes_hold(gauge) for gauge in gauges)
        spreads = by_slope if holds and not gains else by_side
    # What hardly helps on the spheres themselves, nor explains the steps, is chance and would do
    # harm elsewhere.
    full, useful = np.abs(system.solve(spreads)[1]), list(spreads)
    for k in range(2):
        none = [*spreads[:k], spreads[k] * _NOTHING, *spreads[k + 1 :]]
        left = np.abs(system.solve(none)[1])
        own = lines.on_slope & lines.of_sphere & (lines.polarity == k)
        helps_little = own.any() and np.median(full[own]) > _HELPS * np.median(left[own])
        if helps_little and system.cost(none) - system.cost(spreads) < least:
            useful[k] = none[k]
    for k in range(2):
        # Of what lifts all edges alike spheres, whose own level is free, say nothing.
        less = [*useful[:k], _without(useful[k], _EVEN), *useful[k + 1 :]]
        if system.cost(less) - system.cost(useful) < min(least, _GAINS_ALIKE * max(steps, 1)):
            useful = less
    return useful


def sure_slope(lines: GaugeLines) -> float:
    """Slope from which on drift turns none over, with the sign of the side that rising walls face.

    0 where the gauges don't tell the side.
    """
    slope, rise, side = (v[lines.on_slope] for v in (lines.slope, lines.rise, lines.side))
    turned = np.abs(slope[slope * rise < 0])
    steepest = np.quantile(turned, _TURNED) if len(turned) >= LEAST_LINES // 2 else 0.0
    faces = np.sign(np.mean(side * np.sign(rise)))
    return round(float(faces * max(steepest, WALL_SLOPE)), 3)


def _without(spread: F64, term: int) -> F64:
    """Spreads of a polarity's terms, one of them next to nothing."""
    return np.asarray(spread * np.where(np.arange(TERMS) == term, _NOTHING, 1.0))


def _even_alone(spreads: list[F64], lines: GaugeLines) -> list[F64]:
    """Spreads with what lifts all edges alike alone, of polarities that enough of walls show."""
    even, own = np.arange(TERMS) == _EVEN, list(spreads)
    for k in range(2):
        walls = lines.on_slope & ~lines.of_sphere & (lines.polarity == k)
        own[k] = spreads[k] * np.where(even & (walls.sum() >= LEAST_LINES), 1.0, _NOTHING)
    return own


def _leading(spread: F64) -> int | None:
    """Term that tells which way a wall rises; where all drift alike, the one of that.

    None where nothing is corrected.
    """
    kept = [term for term in (_SIDE, _SLOPE, _EVEN) if spread[term] > _PRIOR_M * 2 * _NOTHING]
    return kept[0] if kept else None


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


def _median(values: F64) -> float:
    return float(np.median(values)) if len(values) else _PRIOR_M
