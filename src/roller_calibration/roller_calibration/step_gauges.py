"""Edge drift on steps of equal height: the level of a wall says how high its lines should be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.methods.surface import SurfaceSettings

from .gauge import (
    LEAST_LINES,
    OTHER_SIZE,
    Gauge,
    OffSizeError,
    OtherGaugeError,
    of_lines_or_depths,
    size_text,
    take,
)
from .pass_lines import WALL_SLOPE, EdgeDriftError, PassLines
from .printed_steps import find_printed_steps
from .recordings import Scan
from .step_walls import (
    I64,
    LEAST_WALLS,
    find_walls,
    nearest_wall,
    parts_by_kind,
    rising_walls,
    step_height,
)

#: How far the height of the steps that fit may be off.
_STEP_TOLERANCE = {"lines": 0.15, "depths": 0.25}
#: Spread of where on a wall events arise, by the steps' height.
_ON_WALL = 0.15
#: Spread of the slope of a wall where its lines lie: they climb with it.
_WALL_RISE = 1.0
#: What is further from the median of a gauge's errors than so many steps is of no wall.
_STRAY = 2.5
#: Scatter of the depths of a kind, over walls and on them, from which on they tell nothing, m, and
#: fewest of a wall that count.
_SCATTER_M, _LEAST_ON_WALL = 7.5e-5, 20
#: Share by which other lines on walls have to be more than those before to be taken.
_MANY = 1.5
#: So near to the middle of its wall is what a printed skin shows on it, by the steps' height.
_ON_PRINTED = 0.6
#: Walls of a kind that differ by more, in steps, are numbered wrong: one between them is missing.
_APART = 0.3
#: Steps whose foot is found so near to the nominal surface stand on it, and how surely they do, m.
_MOST_FOOT_M, _STANDS_M = 3e-4, 2e-5


@dataclass(frozen=True)
class _Walls:
    """Walls of steps, and the lines on them."""

    #: Number of the wall that each line is of; -1: none. Shape (n,).
    number: I64
    #: Twice the polarity of each line, and 1 more on walls that fall. Shape (n,).
    kind: I64
    #: Where each line lies across the walls, m. Shape (n,).
    across: F64
    #: 1 for a wall that goes up along the roll, -1 for one that goes down. Shape (walls,).
    change: F64
    #: Height of each wall's middle, in steps. Shape (walls,).
    middle: F64
    #: How far over its wall's middle each kind lies, in steps. Shape (4,).
    part: F64
    #: Height of a step, as found.
    step_m: float


def steps_gauges(scan: Scan, settings: SurfaceSettings, step_m: float) -> list[Gauge]:
    """Errors of the lines on the walls of steps of equal height, up and down, by pass.

    Raises
    ------
    EdgeDriftError
        If the steps can't be found, or have another height.
    """

    def measure(passes: list[PassLines]) -> list[Gauge]:
        return [_on_steps(scan.name, own, step_m, settings.surface_z_m) for own in passes]

    return of_lines_or_depths(scan, settings, measure)


def _on_steps(name: str, found: PassLines, step_m: float, surface_z_m: float) -> Gauge:
    steep, polarity = np.abs(found.lines.slope) > WALL_SLOPE, found.lines.polarity
    every = np.ones_like(steep)
    if found.printed:
        return _on_walls(
            name, found, every, _printed_walls(name, found, step_m), step_m, surface_z_m
        )
    # A wall that one line alone shows, or that drift levels, seems to have no slope. And one
    # polarity may gather between walls: as many must go up as go down.
    best: Gauge | None = None
    level = False
    reason: EdgeDriftError | None = None
    for which in (steep, every, polarity == 0, polarity == 1):
        try:
            walls = _find_walls(name, found, which, step_m)
            gauge = _on_walls(name, found, which, walls, step_m, surface_z_m)
        except EdgeDriftError as error:
            reason = reason or error
            continue
        balanced = bool(walls.change.sum() == 0)
        many = best is None or len(gauge.error_m) > _MANY * len(best.error_m)
        if best is None or (balanced, many) > (level, False):
            best, level = gauge, balanced
    if best is None:
        assert reason is not None
        raise reason
    return best


def _on_walls(
    name: str,
    found: PassLines,
    which: npt.NDArray[np.bool_],
    walls: _Walls,
    step_m: float,
    surface_z_m: float,
) -> Gauge:
    """Errors of some of the lines, which lie on walls."""
    on = walls.number >= 0
    lines, at, kind = take(take(found.lines, which), on), walls.number[on], walls.kind[on]
    level = step_m * (walls.middle[at] + walls.part[kind])
    # Steps that begin at the height of the nominal surface stand on it; on others the height of
    # all is not known.
    base = found.place[which][on] @ found.axes.T
    foot_m = float(np.median(base[:, 2] - level)) - surface_z_m
    stands = abs(foot_m) < _MOST_FOOT_M
    error = found.place[which][on, 2] - level
    error += foot_m - np.median(error) if stands else -np.median(error)
    near = _near_their_walls(name, found.kind, error, at, kind, step_m)
    # How far up its wall a kind lies stays uncertain.
    kinds = kind == np.arange(4)[:, None]
    further_m = _further_m(walls.across[on], at, kind)
    unknown = np.column_stack([np.ones(len(error)), *kinds, *(kinds * further_m)])
    text = (
        f"{len(walls.change)} walls of {size_text(walls.step_m, step_m, '--step-mm')}, "
        f"{int(near.sum())} {found.kind} on them, foot "
        f"{foot_m * 1e6:+.0f} µm " + ("off" if stands else "away from") + " the nominal surface"
    )
    spread = np.array([_STANDS_M if stands else 1e-3, *[_ON_WALL * step_m] * 4, *[_WALL_RISE] * 4])
    return Gauge(
        name, error[near], unknown[near].astype(float), spread, take(lines, near),
        walls.change[at][near], False, text, found.travel,
    )  # fmt: skip


def _find_walls(name: str, found: PassLines, steep: npt.NDArray[np.bool_], step_m: float) -> _Walls:
    """The walls of steps on which some of the lines lie.

    Raises
    ------
    EdgeDriftError
        If there are too few of either, or their heights are not those of steps of the given one.
    """
    if steep.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: {int(steep.sum())} {found.kind} on slopes along the roll, fewer than "
            f"{LEAST_LINES}: no steps in view"
        )
    x, y, height = found.place[steep].T
    lines = take(found.lines, steep)
    wall, count, across = find_walls(x, y, lines.slope, lines.sigma_m, step_m)
    if count < LEAST_WALLS:
        raise EdgeDriftError(f"{name}: {count} walls of steps across the roll, fewer than 2")
    given = wall, lines.polarity, height, lines.slope, count
    rising, misfit = rising_walls(*given, step_m)
    if found.kind == "lines" and rising.all() | (~rising).all():
        raise EdgeDriftError(f"{name}: lines on walls that rise alone, or fall; record both")
    change = np.where(rising, 1.0, -1.0)
    middle = np.cumsum(change) - 0.5 * change
    kind = 2 * lines.polarity + (~rising)[np.maximum(wall, 0)]
    fitted_m = step_height(wall, kind, height, middle)
    if np.isnan(fitted_m):
        raise EdgeDriftError(
            f"{name}: {count} walls don't tell the steps' height: record two steps or more up, or "
            "two down"
        )
    if not abs(fitted_m / step_m - 1) < _STEP_TOLERANCE[found.kind]:
        other = abs(fitted_m / step_m - 1) > OTHER_SIZE
        raise (OtherGaugeError if other else OffSizeError)(
            f"{name}: {count} walls fit steps of {fitted_m * 1e3:.3f} mm, not "
            f"{step_m * 1e3:g} mm; check --step-mm, and that all steps are equal"
        )
    # Of steps half as high, up and down can be told so that they seem twice their height.
    if rising_walls(*given, 0.5 * step_m)[1] < misfit:
        raise OtherGaugeError(
            f"{name}: {count} walls fit steps of {0.5e3 * step_m:g} mm better than of "
            f"{step_m * 1e3:g} mm; check --step-mm"
        )
    # A wall's foot and its top show in a polarity each, or both in both.
    part = parts_by_kind(across, wall, kind, rising)
    return _Walls(wall, kind, across, change, middle, part, fitted_m)


def _printed_walls(name: str, found: PassLines, step_m: float) -> _Walls:
    """The same under a printed skin, whose specks show all of a wall in both polarities.

    Raises
    ------
    EdgeDriftError
        If there are too few walls, or their heights are not those of steps of the given one.
    """
    steps = find_printed_steps(found.place, found.lines.sigma_m, step_m)
    if steps is None or len(steps.at_m) < LEAST_WALLS:
        raise EdgeDriftError(f"{name}: fewer than {LEAST_WALLS} walls of steps across the roll")
    if not abs(steps.step_m / step_m - 1) < _STEP_TOLERANCE["lines"]:
        raise OtherGaugeError(
            f"{name}: {len(steps.at_m)} walls fit steps of {steps.step_m * 1e3:.3f} mm, not "
            f"{step_m * 1e3:g} mm; check --step-mm, and that all steps are equal"
        )
    across, on = steps.places(found.place)
    wall, off = nearest_wall(across, steps.at_m)
    number = np.where(on & (np.abs(off) < _ON_PRINTED * step_m), wall, -1)
    kind = 2 * found.lines.polarity + (steps.change[wall] < 0)
    return _Walls(number, kind, across, steps.change, steps.middle, np.zeros(4), steps.step_m)


def _near_their_walls(
    name: str, what: str, error: F64, wall: I64, kind: I64, step_m: float
) -> npt.NDArray[np.bool_]:
    """Which lines are of the walls that they lie on, and no strays.

    Raises
    ------
    EdgeDriftError
        If walls are numbered wrong, or too few lines are left.
    """
    near = np.abs(error - np.median(error)) < max(_STRAY * step_m, 3e-4)
    for k in range(4):
        own = near & (kind == k)
        walls = [error[own & (wall == w)] for w in np.unique(wall[own])]
        middles = [np.median(values) for values in walls if len(values) >= _LEAST_ON_WALL]
        if middles and _mad(np.array(middles)) > _APART * step_m:
            raise EdgeDriftError(f"{name}: some of the steps' walls aren't found")
        # A kind that shows on no wall is of strays; one that scatters, or by which walls differ, of
        # edges mistaken for others.
        scatter_m = max(_mad(error[own]), _mad(np.array(middles))) if middles else 0.0
        if not middles or (what == "depths" and scatter_m > _SCATTER_M):
            near &= kind != k
    if near.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: what is found on its walls scatters too much to tell drift; softer light, "
            "or a printed skin, helps"
        )
    return near


def _further_m(across: F64, wall: I64, kind: I64) -> F64:
    """How much further along the roll lines lie than the middle of their kind on their wall."""
    further = np.zeros(len(across))
    for number in np.unique(4 * wall + kind):
        own = 4 * wall + kind == number
        further[own] = across[own] - np.median(across[own])
    return further


def _mad(values: F64) -> float:
    return float(np.median(np.abs(values - np.median(values))))
