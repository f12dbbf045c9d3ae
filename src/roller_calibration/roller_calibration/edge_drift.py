"""The drift of edges from passes over a sphere and over steps of known height.

Lines are fitted to the events of each pass without a correction; what they are too high by on the
two gauges is the drift. A line's place along the roll is right whatever its height, so on a sphere
the true height follows from the place, and on steps from the level. Two things a gauge doesn't
say stay unknown of the fit, each with a spread of its own: where the sphere's middle is along the
roll, and how high on a step's wall the events of a polarity arise. Drift moves the middle as well,
and what delays events; rolled over to and fro they move it both ways, and it is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.signal import find_peaks

from roller_core.errors import RollerError
from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import SLOPE_BINS, TERMS, EdgeDriftSettings, drift_terms
from roller_emvs.lines.refine import LinePoints
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.methods.surface.sweep import SurfacePatch

from .recordings import Scan
from .sphere import Sphere, SphereError, find_sphere

#: Lines of a gauge, at least, and on slopes.
LEAST_LINES = 100
#: Slope along the roll from which a line is on a wall.
_WALL = 0.1
#: Bins in which walls are found, m; a wall stands out by this share of the fullest; no two are
#: nearer than this, in bins, and lines within half of it are a wall's own.
_BIN_M, _WALL_SHARE, _WALL_BINS = 5e-5, 0.15, 6
#: Peaks nearer than this share of a long gap between them are of one wall, if both rise or both
#: fall, and which quantile of the gaps is a long one.
_SAME_WALL, _LONG_GAP = 0.5, 0.8
#: Empty bins after the last line, so that a wall there is a peak.
_AFTER = np.zeros(_WALL_BINS)
#: Uncertainty of lines that count in full when walls are found, m.
_SURE_M = 1.5e-5
#: Turns of the steps against the roll that are tried, rad.
_TURNS = np.radians(np.linspace(-3.0, 3.0, 61))
#: Fewest walls, and how far the height of the steps that fit may be off.
_LEAST_WALLS, _STEP_TOLERANCE = 2, 0.15
#: Lines of a polarity on a wall, at least, to tell its height.
_LEAST_ON_WALL = 20
#: Spread of where the sphere's middle is along the roll after a pass one way, and to and fro, m;
#: of the events' delay before and after it was calibrated, s; and of where on a wall events arise,
#: by the steps' height.
_MIDDLE_M, _BOTH_WAYS_M = 1.5e-4, 2e-5
_DELAY_S, _CALIBRATED_DELAY_S = 5e-4, 3e-5
_ON_WALL = 0.5
#: Change of the events' density up to which light stands still, and from which it travels: on the
#: virtual cell 0.2-1 under a dome, 2-6 under its ring.
_STILL, _TRAVELS = 1.0, 1.6
#: Spread of the coefficients before anything was measured, m.
_PRIOR_M = 1.5e-4
#: Share of the median error from which on a polarity's correction is left out, and of its spread
#: that stands for none.
_HELPS, _NOTHING = 0.9, 1e-3
#: Deviation from which on lines count less, m, and rounds of that.
_HUBER_M, _ROUNDS = 6e-5, 20
#: Fewest lines of a bin of slopes whose residual is its own, and least residual, m.
_LEAST_IN_BIN, _LEAST_RESIDUAL_M = 15, 5e-6


class EdgeDriftError(RollerError):
    """Gauges from which no drift can be had."""


@dataclass(frozen=True)
class Gauge:
    """Lines of a pass over a gauge, with their heights over what they should have.

    Attributes
    ----------
    name : str
        Of the recording.
    error_m : ndarray of float64, shape (n,)
        Height less the gauge's.
    unknown : ndarray of float64, shape (n, k)
        How the heights of the lines change with what is unknown of the gauge.
    spread : ndarray of float64, shape (k,)
        Spread of that.
    lines : LinePoints
        The lines.
    sphere : bool
        Whether it is a sphere, on which the height of every place is known.
    text : str
        What was found, for people.
    """

    name: str
    error_m: F64
    unknown: F64
    spread: F64
    lines: LinePoints
    sphere: bool
    text: str


@dataclass(frozen=True)
class EdgeDrift:
    """What was found.

    Attributes
    ----------
    settings : EdgeDriftSettings
        The drift.
    before_m, after_m : tuple of float
        Median absolute error of the lines of OFF and of ON events, without the correction and
        with it, metres.
    """

    settings: EdgeDriftSettings
    before_m: tuple[float, float]
    after_m: tuple[float, float]


@dataclass(frozen=True)
class PassLines:
    """Lines of a pass in its own frame: along the roll, across, and towards the camera, metres.

    `cloud` are the points in base of all passes of the recording.
    """

    place: F64
    lines: LinePoints
    cloud: F64
    axes: F64


def pass_lines(scan: Scan, settings: SurfaceSettings) -> list[PassLines]:
    """Fit the lines of a recording's passes, without a correction: to, or to and fro.

    Raises
    ------
    EdgeDriftError
        If there are too few of them, or a pass goes in a third direction.
    """
    plain = settings.changed({"edge_drift": EdgeDriftSettings.create({})})
    sweep = SurfaceSweep(plain, scan.camera, scan.track)
    found: list[tuple[F64, F64, LinePoints]] = []
    sweep.on_lines = lambda *lines: found.append(lines)
    sweep.add_events(scan.events)
    cloud = [r.points for r in sweep.results(flush=True) if isinstance(r, SurfacePatch)]
    count = sum(len(place) for place, _, _ in found)
    if count < LEAST_LINES:
        raise EdgeDriftError(
            f"{scan.name}: {count} lines, fewer than {LEAST_LINES}: too few edges in view; does it "
            "show the gauge, and is the depth range right?"
        )
    along = np.array([own[:, 0] @ found[0][1][:, 0] for _, own, _ in found])
    if (np.abs(along) < 0.9).any():
        raise EdgeDriftError(f"{scan.name}: passes in several directions; roll to and fro")
    passes = []
    for sign in (1.0, -1.0):
        own = [part for part, a in zip(found, along, strict=True) if a * sign > 0]
        if not own:
            continue
        axes = own[0][1]
        towards = np.column_stack([axes[:, 0], axes[:, 1], -axes[:, 2]])
        lines = LinePoints(
            **{
                name: np.concatenate([getattr(part, name) for _, _, part in own])
                for name in LinePoints.__dataclass_fields__
            }
        )
        place = np.concatenate([place for place, _, _ in own]) @ towards
        passes.append(PassLines(place, lines, np.concatenate(cloud), towards))
    return passes


def sphere_gauges(scan: Scan, settings: SurfaceSettings, radius_m: float) -> list[Gauge]:
    """Errors of the lines on a sphere of known radius, by pass.

    Raises
    ------
    EdgeDriftError
        If the sphere can't be found, or shows too few lines.
    """
    passes = pass_lines(scan, settings)
    try:
        sphere = find_sphere(passes[0].cloud, passes[0].axes[:, 2], radius_m)
    except SphereError as reason:
        raise EdgeDriftError(f"{scan.name}: {reason}") from reason
    delay_s = _CALIBRATED_DELAY_S if settings.event_delay_s else _DELAY_S
    middle = _MIDDLE_M if len(passes) == 1 else np.hypot(_BOTH_WAYS_M, delay_s * _speed(scan))
    return [_on_sphere(scan.name, own, sphere, float(middle)) for own in passes]


def _speed(scan: Scan) -> float:
    """Speed of the pass, m/s."""
    steps = np.linalg.norm(np.diff(scan.track.positions, axis=0), axis=1)
    return float(np.quantile(steps / (np.diff(scan.track.times_ns) * 1e-9), 0.9))


def _on_sphere(name: str, found: PassLines, sphere: Sphere, middle_m: float) -> Gauge:
    radius_m = sphere.radius_m
    away = found.place - sphere.centre_m @ found.axes
    rho = np.hypot(away[:, 0], away[:, 1])
    inside = rho < sphere.contact_radius_m
    if inside.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: {int(inside.sum())} lines on the sphere, fewer than {LEAST_LINES}: too "
            "little of it is in view, or its skin shows too little"
        )
    away, rho = away[inside], rho[inside]
    below = np.sqrt(radius_m**2 - rho**2)
    error = away[:, 2] - below
    unknown = np.column_stack([away[:, :2] / below[:, None], np.ones(len(below))])
    # Steep and stray lines are of the sphere's foot.
    near = np.abs(error - np.median(error)) < max(0.1 * radius_m, 4e-4)
    text = (
        f"sphere of {sphere.fitted_radius_m * 1e3:.2f} mm, {int(near.sum())} lines within "
        f"{sphere.contact_radius_m * 1e3:.2f} mm of its top"
    )
    spread = np.array([middle_m, 1e-3, 1e-3])
    return Gauge(
        name, error[near], unknown[near], spread, _take(_take(found.lines, inside), near), True,
        text,
    )  # fmt: skip


def steps_gauges(scan: Scan, settings: SurfaceSettings, step_m: float) -> list[Gauge]:
    """Errors of the lines on the walls of steps of equal height, up and down, by pass.

    Raises
    ------
    EdgeDriftError
        If the steps can't be found, or have another height.
    """
    return [_on_steps(scan.name, own, step_m) for own in pass_lines(scan, settings)]


def _on_steps(name: str, found: PassLines, step_m: float) -> Gauge:
    slope = found.lines.slope
    steep = np.abs(slope) > _WALL
    if steep.sum() < LEAST_LINES:
        raise EdgeDriftError(
            f"{name}: {int(steep.sum())} lines on slopes along the roll, fewer than "
            f"{LEAST_LINES}: no steps in view"
        )
    x, y, height = found.place[steep].T
    lines = _take(found.lines, steep)
    wall, count = _walls(x, y, lines.slope, lines.sigma_m, step_m)
    if count < _LEAST_WALLS:
        raise EdgeDriftError(f"{name}: {count} walls of steps across the roll, fewer than 2")
    rising = np.array([np.median(lines.slope[wall == k]) > 0 for k in range(count)])
    change = np.where(rising, 1.0, -1.0)
    middle = np.cumsum(change) - 0.5 * change
    kind = 2 * lines.polarity + (~rising)[np.maximum(wall, 0)]
    fitted_m = _step_height(wall, kind, height, middle, name)
    if not abs(fitted_m / step_m - 1) < _STEP_TOLERANCE:
        raise EdgeDriftError(
            f"{name}: {count} walls fit steps of {fitted_m * 1e3:.3f} mm, not "
            f"{step_m * 1e3:g} mm; check --step-mm, and that all steps are equal"
        )
    on = wall >= 0
    lines, at = _take(lines, on), wall[on]
    error = height[on] - step_m * middle[at]
    # Where on a wall events of a kind arise is not known.
    unknown = np.column_stack([np.ones(len(error)), *(kind[on] == k for k in range(4))])
    error -= np.median(error)
    near = np.abs(error) < max(1.5 * step_m, 3e-4)
    text = f"{count} walls of {fitted_m * 1e3:.3f} mm, {int(near.sum())} lines on them"
    spread = np.array([1e-3, *[_ON_WALL * step_m] * 4])
    return Gauge(
        name, error[near], unknown[near].astype(float), spread, _take(lines, near), False, text
    )


def _step_height(
    wall: npt.NDArray[np.int64], kind: npt.NDArray[np.int64], height: F64, middle: F64, name: str
) -> float:
    """Height of a step, from walls that are alike: of one polarity, all rising or all falling.

    Raises
    ------
    EdgeDriftError
        If no two walls are alike.
    """
    rows, heights = [], []
    for k in range(4):
        for w in range(len(middle)):
            own = (wall == w) & (kind == k)
            if own.sum() >= _LEAST_ON_WALL:
                rows.append([middle[w], *(k == j for j in range(4))])
                heights.append(np.median(height[own]))
    design = np.array(rows, float).reshape(-1, 5)
    if np.linalg.matrix_rank(design) == np.linalg.matrix_rank(design[:, 1:]):
        raise EdgeDriftError(
            f"{name}: {len(middle)} walls don't tell the steps' height: record two steps or more "
            "up, or two down"
        )
    return float(np.linalg.lstsq(design, np.array(heights), rcond=None)[0][0])


def fit_drift(gauges: list[Gauge]) -> EdgeDrift:
    """Fit the drift of each polarity to the gauges.

    Least squares with what is unknown of the gauges, ridge and Huber's weights.

    Raises
    ------
    EdgeDriftError
        If too few lines lie on slopes.
    """
    lines = [gauge.lines for gauge in gauges]
    slope, lean, change, polarity, sigma = (
        np.concatenate([getattr(own, name) for own in lines])
        for name in ("slope", "lean", "change", "polarity", "sigma_m")
    )
    error = np.concatenate([gauge.error_m for gauge in gauges])
    on_slope = np.abs(slope) > _WALL
    if on_slope.sum() < LEAST_LINES:
        raise EdgeDriftError(f"{int(on_slope.sum())} lines on slopes, fewer than {LEAST_LINES}")
    terms = drift_terms(slope, change)
    columns = [np.where((polarity == k)[:, None], terms, 0.0) for k in (0, 1)]
    # Where events lie evenly over the crossing the light stands still: then there is no drift, and
    # what the gauges are off by is where on a wall events arise.
    travel = float(np.median(np.abs(lean[on_slope])))
    travels = float(np.clip((travel - _STILL) / (_TRAVELS - _STILL), 1e-3, 1.0))
    spreads = [np.full(TERMS, travels * _PRIOR_M) for _ in range(2)]
    for k, gauge in enumerate(gauges):
        column = np.zeros((len(error), gauge.unknown.shape[1]))
        start = sum(len(g.error_m) for g in gauges[:k])
        column[start : start + len(gauge.error_m)] = gauge.unknown
        columns.append(column)
        spreads.append(gauge.spread)
    design = np.concatenate(columns, axis=1)
    # A gauge counts as a whole as much as the other: neighbouring lines share what they err by.
    share = np.concatenate([np.full(len(g.error_m), LEAST_LINES / len(g.error_m)) for g in gauges])
    noise = np.hypot(sigma, _HUBER_M)
    full = _solve(design, error, spreads, share, noise)[1]
    # What hardly helps on the spheres themselves is chance, and would do harm elsewhere.
    every = spreads[:2]
    on_spheres = on_slope & np.repeat([g.sphere for g in gauges], [len(g.error_m) for g in gauges])
    for k in range(2):
        none = [*every[:k], every[k] * _NOTHING, *every[k + 1 :], *spreads[2:]]
        without = _solve(design, error, none, share, noise)[1]
        own = on_spheres & (polarity == k)
        if own.any() and np.median(np.abs(full[own])) > _HELPS * np.median(np.abs(without[own])):
            spreads[k] = every[k] * _NOTHING
    beta, rest, normal = _solve(design, error, spreads, share, noise)
    of_gauge = design[:, 2 * TERMS :] @ beta[2 * TERMS :]
    most = float(np.quantile(np.abs(slope[on_slope]), 0.98))
    # What neither gauge fixes of the coefficients is uncertain too.
    own = design[:, : 2 * TERMS]
    covariance = np.linalg.inv(normal)[: 2 * TERMS, : 2 * TERMS]
    unsure = np.sqrt(np.einsum("ij,jk,ik->i", own, covariance, own))
    table = _residuals(rest, unsure, slope, polarity, most)
    settings = EdgeDriftSettings.create(
        {
            "coefficients_m": [float(f"{v:.4g}") for v in beta[: 2 * TERMS]],
            "residual_m": [float(f"{v:.3g}") for v in table.ravel()],
            "max_slope": round(most, 3),
        }
    )
    off, on = (on_slope & (polarity == k) for k in (0, 1))
    plain = np.abs(error - of_gauge)
    before = _median(plain[off]), _median(plain[on])
    after = _median(np.abs(rest[off])), _median(np.abs(rest[on]))
    return EdgeDrift(settings, before, after)


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
        weight = np.minimum(1.0, 1.5 * noise / np.maximum(np.abs(rest), 1e-9))
    return np.asarray(beta, np.float64), rest, normal


def _median(values: F64) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _residuals(rest: F64, unsure: F64, slope: F64, polarity: F64, most: float) -> F64:
    """What is left, as a standard deviation, by polarity, direction and bin of slopes."""
    table = np.full((2, 2, SLOPE_BINS), np.nan)
    bins = np.minimum((np.abs(slope) / most * SLOPE_BINS).astype(int), SLOPE_BINS - 1)
    for p in range(2):
        for falling in range(2):
            kind = (polarity == p) & ((slope < 0) == bool(falling))
            for b in range(SLOPE_BINS):
                here = kind & (bins == b)
                if here.sum() >= _LEAST_IN_BIN:
                    # 68 % lie within one deviation, whatever the tails.
                    spread = max(np.quantile(np.abs(rest[here]), 0.683), _LEAST_RESIDUAL_M)
                    table[p, falling, b] = np.hypot(spread, np.median(unsure[here]))
            # A slope that no gauge shows is as uncertain as the drift is before it is measured.
            table[p, falling] = _filled(table[p, falling])
    return table


def _filled(row: F64) -> F64:
    known = np.flatnonzero(np.isfinite(row))
    if not len(known):
        return np.full(len(row), _PRIOR_M)
    return np.interp(np.arange(len(row)), known, row[known])


def _walls(
    x: F64, y: F64, slope: F64, sigma_m: F64, step_m: float
) -> tuple[npt.NDArray[np.int64], int]:
    """Number of the wall that each line is of, from the first on (-1: none), and how many."""
    weight = np.minimum(1.0, (_SURE_M / sigma_m) ** 2)
    y = y - np.median(y)
    sharpest = -1.0
    across: F64 = x
    smooth: F64 = np.empty(0)
    for turn in _TURNS:
        turned = x * np.cos(turn) + y * np.sin(turn)
        turned -= turned.min() - _WALL_BINS * _BIN_M
        binned = np.append(np.bincount((turned / _BIN_M).astype(int), weight), _AFTER)
        counts = np.asarray(np.convolve(binned, np.ones(3), mode="same"), np.float64)
        sharp = float((counts**2).sum())
        if sharp > sharpest:
            sharpest, across, smooth = sharp, turned, counts
    # Walls are where lines gather.
    least = _WALL_SHARE * np.sort(smooth)[-3 * _LEAST_WALLS :].mean()
    # A wall's foot and its top are one wall: it is hardly less steep than 1.
    width = max(_WALL_BINS, round(1.25 * step_m / _BIN_M))
    peaks, _ = find_peaks(smooth, prominence=least, distance=width)
    wall = np.full(len(x), -1, np.int64)
    if not len(peaks):
        return wall, 0
    near = np.abs(across[:, None] - (peaks + 0.5) * _BIN_M) < 0.5 * width * _BIN_M
    rising = np.array([np.median(slope[own]) > 0 if own.any() else False for own in near.T])
    # Equal steps are as long as each other: what is much nearer is the same wall's other edge.
    gaps = np.diff(peaks)
    apart = gaps > _SAME_WALL * np.quantile(gaps, _LONG_GAP) if len(gaps) else gaps
    number = np.concatenate([[0], np.cumsum(apart | (rising[1:] != rising[:-1]))]).astype(np.int64)
    for k, own in zip(number, near.T, strict=True):
        wall[own] = k
    return wall, int(number[-1]) + 1


def _take(lines: LinePoints, which: npt.NDArray[np.bool_]) -> LinePoints:
    return replace(lines, **{n: getattr(lines, n)[which] for n in LinePoints.__dataclass_fields__})
