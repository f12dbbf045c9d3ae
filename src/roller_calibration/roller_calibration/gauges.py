"""Gauges of edge drift: lines on a sphere and on steps, and what they are too high by.

Lines are fitted to the events of each pass without a correction. A line's place along the roll is
right whatever its height, so on a sphere the true height follows from the place, and on steps from
the level. Two things a gauge doesn't say stay unknown, each with a spread of its own: where the
sphere's middle is along the roll, and how high on a step's wall the events of a polarity arise.
Drift moves the middle as well, and what delays events; rolled over to and fro they move it both
ways, and it is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.signal import find_peaks

from roller_core.errors import RollerError
from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import EdgeDriftSettings
from roller_emvs.lines.refine import LinePoints
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.methods.surface.sweep import SurfacePatch

from .constant_speed import rolling_speed_m_s
from .recordings import Scan
from .sphere import Sphere, SphereError, find_sphere

#: Lines of a gauge, at least, and on slopes.
LEAST_LINES = 100
#: Slope along the roll from which a line is on a wall.
WALL_SLOPE = 0.1
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
    middle = (
        _MIDDLE_M
        if len(passes) == 1
        else np.hypot(_BOTH_WAYS_M, delay_s * rolling_speed_m_s(scan.track))
    )
    return [_on_sphere(scan.name, own, sphere, float(middle)) for own in passes]


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
    steep = np.abs(slope) > WALL_SLOPE
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
