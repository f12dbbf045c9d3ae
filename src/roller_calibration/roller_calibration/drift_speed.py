"""How drift goes with speed: what the same walls differ by from pass to pass.

Where on a wall events arise isn't known, which hides a part of the drift. It is the same at every
speed, though: what walls of one kind are found higher or lower at another speed is drift. One term
of a polarity goes with speed, the one that tells which way a wall rises. That of the change of
contrast doesn't: domes, on which edges drift further, ask for it, and other objects err more with
it (under the virtual cell's ring by 2 µm at 0.1 m/s; less by 0.6 µm at 0.5 m/s with either).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import TERMS, EdgeDriftSettings

from .drift_lines import GaugeLines
from .drift_system import DriftSystem
from .gauge import Gauge

#: Fastest by slowest speed of the steps from which on they tell how drift goes with it.
_APART = 1.3
#: Share of what isn't known of where on a wall events arise that may differ from pass to pass.
_DIFFERS = 0.1
#: By how much the fit has to be better for a term, as Akaike asks of one unknown more. On the
#: virtual cell's gauges OFF gains 2.8 under the ring, OFF 1.5 and ON 0.6 in the light `strong`.
_GAINS = 2.0
#: Fewest lines of a polarity on walls that rise, and that fall, from which on a pass tells.
_LEAST_LINES = 30
#: What the terms are of, for people.
_NAMES = ("change of contrast", "slope", "all walls", "side")


@dataclass(frozen=True)
class SpeedDrift:
    """How drift goes with speed."""

    #: Speed that the coefficients are of, slowest and fastest of the passes over steps, m/s.
    speeds_m_s: tuple[float, float, float]
    #: Change of the coefficients of OFF and of ON events, m per m/s. Shape (2, terms).
    by_speed_s: F64
    #: What that makes of each line's height, and how uncertain that is, m. Shape (n,).
    height_m: F64
    unsure_m: F64


def find_speed_drift(
    system: DriftSystem, spreads: list[F64], gauges: list[Gauge], lines: GaugeLines,
    terms: F64, leading: list[int | None],
) -> SpeedDrift:  # fmt: skip
    """How drift goes with speed, as far as the gauges ask for it.

    Parameters
    ----------
    system : DriftSystem
        The errors as sums of drift and of what is unknown of each gauge.
    spreads : list of ndarray
        What these may be: of the terms of OFF and of ON events, and of each gauge, m.
    gauges : list of Gauge
        The gauges.
    lines : GaugeLines
        Their lines.
    terms : ndarray of float64, shape (n, terms)
        Of the model.
    leading : list of int or None
        Term of OFF and of ON events that may go with speed; None: their drift isn't corrected.
    """
    told = {
        polarity: (term, _speeds(passes))
        for polarity, term in enumerate(leading)
        if term is not None and (passes := _telling(gauges, polarity))
    }
    every = _speeds([gauge for gauge in gauges if not gauge.sphere] or gauges)
    speeds = max((own for _, own in told.values()), key=lambda v: v[2] / v[1], default=every)
    at, slowest, fastest = speeds
    none, by_speed_s = np.zeros(len(lines.error_m)), np.zeros((2, TERMS))
    nothing = SpeedDrift(speeds, by_speed_s, none, none)
    if not told or not fastest > _APART * slowest:
        return nothing
    # A polarity that tells of fewer speeds than the other has none: it would be led beyond them.
    places = [(polarity, term) for polarity, (term, own) in told.items() if own == speeds]
    # By share of the speed: what a coefficient may be it may also change by.
    faster = np.clip(lines.speed_m_s, slowest, fastest) / at - 1.0
    columns = [np.where(lines.polarity == k, terms[:, t] * faster, 0.0) for k, t in places]
    most = [spreads[k][t : t + 1] for k, t in places]
    system, spreads = _same_walls(system, spreads, gauges)
    chosen = _asked_for(system, spreads, columns, most)
    if not chosen:
        return nothing
    system = _with_columns(system, *(columns[c] for c in chosen))
    beta, _, normal = system.solve([*spreads, *(most[c] for c in chosen)])
    last = slice(-len(chosen), None)
    for c, value in zip(chosen, beta[last], strict=True):
        by_speed_s[places[c]] = value / at
    own, covariance = system.design[:, last], np.linalg.inv(normal)[last, last]
    unsure = np.sqrt(np.einsum("ij,jk,ik->i", own, covariance, own))
    return SpeedDrift(speeds, by_speed_s, own @ beta[last], unsure)


def _asked_for(
    system: DriftSystem, spreads: list[F64], columns: list[F64], most: list[F64]
) -> tuple[int, ...]:
    """Which of some further unknowns explain the errors so much better that they are worth it.

    All together, as what lifts both polarities would else pass for the height of the steps.
    """

    def worth(chosen: tuple[int, ...]) -> float:
        more = _with_columns(system, *(columns[c] for c in chosen))
        return more.cost([*spreads, *(most[c] for c in chosen)]) + _GAINS * len(chosen)

    counts = range(len(columns) + 1)
    return min((c for n in counts for c in combinations(range(len(columns)), n)), key=worth)


def speed_text(settings: EdgeDriftSettings) -> str:
    """How drift goes with speed, for people."""
    _, slowest, fastest = settings.speeds_m_s
    if not fastest > _APART * slowest:
        return f"drift by speed: one speed, {fastest:.2g} m/s: not told"
    change = np.array(settings.by_speed_s).reshape(2, TERMS)
    found = [
        f"{('OFF', 'ON')[k]} by {_NAMES[t]} {1e6 * change[k, t]:+.0f} µm per m/s"
        for k, t in np.argwhere(change)
    ]
    text = ", ".join(found) or "no dependence on speed found"
    return f"drift by speed: {text}, {slowest:.2g} to {fastest:.2g} m/s"


def _telling(gauges: list[Gauge], polarity: int) -> list[Gauge]:
    """Passes over steps on which a polarity shows walls that rise and walls that fall.

    Of one kind of wall alone the height of the whole pass, which isn't known, hides the drift.
    """

    def tells(gauge: Gauge) -> bool:
        rise = gauge.rise[gauge.lines.polarity == polarity]
        return min((rise > 0).sum(), (rise < 0).sum()) >= _LEAST_LINES

    return [gauge for gauge in gauges if not gauge.sphere and tells(gauge)]


def _speeds(gauges: list[Gauge]) -> tuple[float, float, float]:
    """Mean, slowest and fastest speed of passes, to 1 mm/s."""
    speeds = [round(float(np.median(gauge.lines.speed_m_s)), 3) for gauge in gauges]
    return round(float(np.mean(speeds)), 3), min(speeds), max(speeds)


def _same_walls(
    system: DriftSystem, spreads: list[F64], gauges: list[Gauge]
) -> tuple[DriftSystem, list[F64]]:
    """What is unknown of the walls of each kind as the same at every pass, but for a share."""
    # The first unknown is the height of all walls, which passes don't share.
    shared = next(own[1:] for own, g in zip(spreads[2:], gauges, strict=True) if not g.sphere)
    columns = [
        np.zeros((len(g.error_m), len(shared))) if g.sphere else g.unknown[:, 1:] for g in gauges
    ]
    own = [
        spread if gauge.sphere else np.append(spread[:1], _DIFFERS * spread[1:])
        for spread, gauge in zip(spreads[2:], gauges, strict=True)
    ]
    return _with_columns(system, np.concatenate(columns)), [*spreads[:2], *own, shared]


def _with_columns(system: DriftSystem, *columns: F64) -> DriftSystem:
    """With further unknowns."""
    design = np.column_stack([system.design, *columns])
    more = np.zeros(design.shape[1] - len(system.own_level), np.bool_)
    own_level, on_wall = (np.append(own, more) for own in (system.own_level, system.on_wall))
    return replace(system, design=design, own_level=own_level, on_wall=on_wall)
