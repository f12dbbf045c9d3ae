"""Gauges of edge drift: lines on a sphere and on steps, and what they are too high by.

Lines are fitted to the events of each pass without a correction. A line's place along the roll is
right whatever its height, so on a sphere the true height follows from the place, and on steps from
the level. Two things a gauge doesn't say stay unknown, each with a spread of its own: where the
sphere's middle is along the roll, and how high on a step's wall the events of a polarity arise.
Drift moves the middle as well, and what delays events; rolled over to and fro they move it both
ways, and it is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.lines.refine import LinePoints
from roller_emvs.methods.surface import SurfaceSettings

from .constant_speed import rolling_speed_m_s
from .pass_lines import WALL_SLOPE, EdgeDriftError, PassLines, pass_lines
from .recordings import Scan
from .sphere import OtherRadiusError, Sphere, SphereError, find_sphere
from .step_walls import LEAST_WALLS, find_walls, parts_by_kind, rising_walls, step_height

#: Lines of a gauge, at least, and on slopes.
LEAST_LINES = 100
#: How far the height of the steps that fit may be off.
_STEP_TOLERANCE = {"lines": 0.15, "depths": 0.25}
#: Share that a gauge's size may be off by drift.
OTHER_SIZE = 0.3
#: Spread of where the sphere's middle is along the roll after a pass one way, and to and fro, m;
#: of the events' delay before and after it was calibrated, s; and of where on a wall events arise,
#: by the steps' height.
_MIDDLE_M, _BOTH_WAYS_M = 1.5e-4, 2e-5
_DELAY_S, _CALIBRATED_DELAY_S = 5e-4, 3e-5
_ON_WALL = 0.15
#: What is further from the median of a gauge's errors than so many steps is of no wall.
_STRAY = 2.5
#: Scatter of the depths of a kind, over walls and on them, from which on they tell nothing, m, and
#: fewest of a wall that count.
_SCATTER_M, _LEAST_ON_WALL = 7.5e-5, 20
#: Share by which other lines on walls have to be more than those before to be taken.
_MANY = 1.5
#: Walls of a kind that differ by more, in steps, are numbered wrong: one between them is missing.
_APART = 0.3
#: Steps whose foot is found so near to the nominal surface stand on it, and how surely they do, m.
_MOST_FOOT_M, _STANDS_M = 3e-4, 2e-5


class OtherGaugeError(EdgeDriftError):
    """A gauge whose size is so far off the stated one that drift doesn't explain it."""


@dataclass(frozen=True)
class Gauge:
    """Lines of a pass over a gauge, with their heights over what they should have."""

    #: Of the recording.
    name: str
    #: Height less the gauge's. Shape (n,).
    error_m: F64
    #: How the heights of the lines change with what is unknown of the gauge. Shape (n, k).
    unknown: F64
    #: Spread of that. Shape (k,).
    spread: F64
    #: The lines.
    lines: LinePoints
    #: Slope of the gauge along the roll at each line; of steps 1 or -1. Shape (n,).
    rise: F64
    #: Whether it is a sphere, on which the height of every place is known.
    sphere: bool
    #: What was found, for people.
    text: str
    #: See `PassLines`.
    travel: float


def all_gauges(
    spheres: Sequence[Scan],
    steps: Sequence[Scan],
    settings: SurfaceSettings,
    radius_m: float,
    step_m: float,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[list[Gauge], list[EdgeDriftError]]:
    """Gauges of all recordings, and why some tell nothing. Steps alone will do.

    Raises
    ------
    OtherGaugeError
        If a gauge has another size, and none of its kind the stated one.
    EdgeDriftError
        If no recording of steps tells anything.
    """
    found: list[Gauge] = []
    left_out: list[EdgeDriftError] = []
    done = 0
    for scans, measure, size_m in (
        (spheres, sphere_gauges, radius_m),
        (steps, steps_gauges, step_m),
    ):
        own: list[Gauge] = []
        other: OtherGaugeError | None = None
        for scan in scans:
            try:
                own += measure(scan, settings, size_m)
            except EdgeDriftError as reason:
                left_out.append(reason)
                other = reason if isinstance(reason, OtherGaugeError) else other
            done += 1
            progress(done / (len(spheres) + len(steps)))
        # Where one fits the stated size is right, and drift larger than the gauge hides the rest.
        if other is not None and not own:
            raise other
        found += own
    # Edges drift further on a sphere, which bends little, than on walls: alone it would do harm.
    if not found or (steps and all(gauge.sphere for gauge in found)):
        raise EdgeDriftError("; ".join(map(str, left_out)))
    return found, left_out


def sphere_gauges(scan: Scan, settings: SurfaceSettings, radius_m: float) -> list[Gauge]:
    """Errors of the lines on a sphere of known radius, by pass.

    Raises
    ------
    EdgeDriftError
        If the sphere can't be found, or shows too few lines.
    """
    delay_s = _CALIBRATED_DELAY_S if settings.event_delay_s else _DELAY_S

    def measure(passes: list[PassLines]) -> list[Gauge]:
        try:
            sphere = find_sphere(passes[0].cloud, passes[0].axes[:, 2], radius_m, OTHER_SIZE)
        except SphereError as reason:
            kind = OtherGaugeError if isinstance(reason, OtherRadiusError) else EdgeDriftError
            raise kind(f"{scan.name}: {reason}") from reason
        middle = (
            _MIDDLE_M
            if len(passes) == 1
            else np.hypot(_BOTH_WAYS_M, delay_s * rolling_speed_m_s(scan.track))
        )
        return [_on_sphere(scan.name, own, sphere, float(middle)) for own in passes]

    return _of_lines_or_depths(scan, settings, measure)


def _of_lines_or_depths(
    scan: Scan, settings: SurfaceSettings, measure: Callable[[list[PassLines]], list[Gauge]]
) -> list[Gauge]:
    """What lines tell, or where those are too few, the depths of neighbourhoods."""
    reason = EdgeDriftError(
        f"{scan.name}: no edges in view; does it show the gauge, and is the depth range right?"
    )
    for passes in pass_lines(scan, settings):
        try:
            return measure(passes)
        except EdgeDriftError as own:
            reason = own
    raise reason


def _on_sphere(name: str, found: PassLines, sphere: Sphere, middle_m: float) -> Gauge:
    radius_m = sphere.radius_m
    away = found.place - sphere.centre_m @ found.axes
    rho = np.hypot(away[:, 0], away[:, 1])
    inside = rho < sphere.contact_radius_m
    if inside.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: {int(inside.sum())} {found.kind} on the sphere, fewer than {LEAST_LINES}: "
            "too little of it is in view, or its skin shows too little"
        )
    away, rho = away[inside], rho[inside]
    below = np.sqrt(radius_m**2 - rho**2)
    error = away[:, 2] - below
    unknown = np.column_stack([away[:, :2] / below[:, None], np.ones(len(below))])
    # Steep and stray lines are of the sphere's foot.
    near = np.abs(error - np.median(error)) < max(0.1 * radius_m, 4e-4)
    text = (
        f"sphere of {sphere.fitted_radius_m * 1e3:.2f} mm, {int(near.sum())} {found.kind} within "
        f"{sphere.contact_radius_m * 1e3:.2f} mm of its top"
    )
    spread = np.array([middle_m, 1e-3, 1e-3])
    return Gauge(
        name, error[near], unknown[near], spread, _take(_take(found.lines, inside), near),
        -(away[:, 0] / below)[near], True, text, found.travel,
    )  # fmt: skip


def steps_gauges(scan: Scan, settings: SurfaceSettings, step_m: float) -> list[Gauge]:
    """Errors of the lines on the walls of steps of equal height, up and down, by pass.

    Raises
    ------
    EdgeDriftError
        If the steps can't be found, or have another height.
    """

    def measure(passes: list[PassLines]) -> list[Gauge]:
        return [_on_steps(scan.name, own, step_m, settings.surface_z_m) for own in passes]

    return _of_lines_or_depths(scan, settings, measure)


def _on_steps(name: str, found: PassLines, step_m: float, surface_z_m: float) -> Gauge:
    steep, polarity = np.abs(found.lines.slope) > WALL_SLOPE, found.lines.polarity
    # A wall that one line alone shows, or that drift levels, seems to have no slope. And one
    # polarity may gather between walls: as many must go up as go down.
    best: Gauge | None = None
    level = False
    reason: EdgeDriftError | None = None
    for which in (steep, np.ones_like(steep), polarity == 0, polarity == 1):
        try:
            gauge, balanced = _on_walls(name, found, which, step_m, surface_z_m)
        except EdgeDriftError as error:
            reason = reason or error
            continue
        many = best is None or len(gauge.error_m) > _MANY * len(best.error_m)
        if best is None or (balanced, many) > (level, False):
            best, level = gauge, balanced
    if best is None:
        assert reason is not None
        raise reason
    return best


def _on_walls(
    name: str, found: PassLines, steep: npt.NDArray[np.bool_], step_m: float, surface_z_m: float
) -> tuple[Gauge, bool]:
    """Errors of some of the lines, and whether as many walls rise as fall."""
    if steep.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: {int(steep.sum())} {found.kind} on slopes along the roll, fewer than "
            f"{LEAST_LINES}: no steps in view"
        )
    x, y, height = found.place[steep].T
    lines = _take(found.lines, steep)
    wall, count, across = find_walls(x, y, lines.slope, lines.sigma_m, step_m)
    if count < LEAST_WALLS:
        raise EdgeDriftError(f"{name}: {count} walls of steps across the roll, fewer than 2")
    rising = rising_walls(wall, lines.polarity, height, lines.slope, count, step_m)
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
        raise (OtherGaugeError if other else EdgeDriftError)(
            f"{name}: {count} walls fit steps of {fitted_m * 1e3:.3f} mm, not "
            f"{step_m * 1e3:g} mm; check --step-mm, and that all steps are equal"
        )
    on = wall >= 0
    lines, at = _take(lines, on), wall[on]
    # A wall's foot and its top show in a polarity each, or both in both.
    part = parts_by_kind(across, wall, kind, rising)[kind[on]]
    level = step_m * (middle[at] + part)
    # Steps that begin at the height of the nominal surface stand on it; on others the height of
    # all is not known.
    base = found.place[steep][on] @ found.axes.T
    foot_m = float(np.median(base[:, 2] - level)) - surface_z_m
    stands = abs(foot_m) < _MOST_FOOT_M
    error = height[on] - level
    error += foot_m - np.median(error) if stands else -np.median(error)
    # How far up its wall a kind lies stays uncertain.
    unknown = np.column_stack([np.ones(len(error)), *(kind[on] == k for k in range(4))])
    near = np.abs(error - np.median(error)) < max(_STRAY * step_m, 3e-4)
    for k in range(4):
        own = near & (kind[on] == k)
        walls = [error[own & (at == w)] for w in np.unique(at[own])]
        middles = [np.median(values) for values in walls if len(values) >= _LEAST_ON_WALL]
        if middles and _mad(np.array(middles)) > _APART * step_m:
            raise EdgeDriftError(f"{name}: some of the steps' walls aren't found")
        # A kind that shows on no wall is of strays; one that scatters, or by which walls differ, of
        # edges mistaken for others.
        scatter_m = max(_mad(error[own]), _mad(np.array(middles))) if middles else 0.0
        if not middles or (found.kind == "depths" and scatter_m > _SCATTER_M):
            near &= kind[on] != k
    if near.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: what is found on its walls scatters too much to tell drift; softer light, "
            "or a printed skin, helps"
        )
    text = (
        f"{count} walls of {fitted_m * 1e3:.3f} mm, {int(near.sum())} {found.kind} on them, foot "
        f"{foot_m * 1e6:+.0f} µm " + ("off" if stands else "away from") + " the nominal surface"
    )
    spread = np.array([_STANDS_M if stands else 1e-3, *[_ON_WALL * step_m] * 4])
    gauge = Gauge(
        name, error[near], unknown[near].astype(float), spread, _take(lines, near),
        change[at][near], False, text, found.travel,
    )  # fmt: skip
    return gauge, bool(change.sum() == 0)


def _mad(values: F64) -> float:
    return float(np.median(np.abs(values - np.median(values))))


def _take(lines: LinePoints, which: npt.NDArray[np.bool_]) -> LinePoints:
    return replace(lines, **{n: getattr(lines, n)[which] for n in LinePoints.__dataclass_fields__})
