"""Points follow the lines around them; lines that are surer become points themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from roller_core.transforms import F64
from roller_emvs.evidence import CELL_PX, EvidenceField, Relief
from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _place_kernels as kernels
from .edge_drift import EdgeDriftSettings, TravellingLight, drift_of_wider, edge_drift, held_change
from .fit import I64, INDEPENDENT, NO_LINES, ROW_STEP, Lines, fit_lines

#: A point within this of a line, along the parallax, is of the same feature, px.
_SAME_PX = 1
#: Uncertainty of a line's place that its fit doesn't know of, m: the poses' stamps and noise.
_PLACE_M = 1.5e-5
#: Least slope at a line: where one polarity alone shows a wall, the surface around shows none.
_LEAST_SLOPE = 0.6
#: Correlation of what a line and the points around it err by: they are of the same events.
#: On the virtual cell's gauges 0.6-0.9.
_ALIKE = 0.7
#: Share of what line and neighbourhood differ by that stays in doubt.
_DOUBT = 1 / 3
#: Least uncertainty of a line's height, m.
_FLOOR_M = 1.2e-5
#: Neighbourhood over which points err alike, px, and what that changes over it, m.
_SHARED_PX, _CHANGES_M = 4.0, 3e-5
#: The foot and the top of a wall err apart: what points are moved by goes linearly along the row,
#: held back as if lines lay so far around, px.
_STIFF_PX = 1.0
#: The level from which a pixel tells an edge is that where it woke up after the one before, and
#: hangs on that: the place is unsure by so much of the travel meanwhile.
_WAKES = 0.15
#: Drift of lines, where light travels and nothing is calibrated, and what of it a neighbourhood of
#: both polarities errs by, m. Tuned on the virtual cell.
_UNKNOWN_DRIFT_M, _POINT_DRIFT_M = 1.3e-4, 8e-5
#: Where light travels, what drift a line has hangs on its own polarity and wall, of which a
#: calibration knows little: to the points around it is less sure by this share.
_ONE_SIDED = 0.5


@dataclass(frozen=True)
class LinePoints:
    """Lines of a field with what their drift depends on; arrays of shape (n,)."""

    #: Place on the grid, px.
    row: F64
    column: F64
    #: As the fit has it, drift and all.
    offset: F64
    #: 0 for OFF, 1 for ON events.
    polarity: I64
    #: dh/dx of the surface, h towards the camera.
    slope: F64
    #: How fast the events get more along the crossing: mean of the rays' slopes less the middle of
    #: the aperture, by their variance.
    lean: F64
    #: The same of the cell around; see `crossing_change`.
    change: F64
    #: See `wall_side`.
    side: F64
    #: Uncertainty of the height but for drift, metres.
    sigma_m: F64
    #: Width of the band in which its events lie, one deviation, metres; 0: unknown.
    width_m: F64
    #: Speed of the camera when its events came, m/s.
    speed_m_s: F64


def refine(
    field: EvidenceField,
    found: Relief,
    rays: Callable[[int], F32],
    columns: tuple[int, int],
    settings: EdgeDriftSettings,
    light: TravellingLight,
    blind_m: float,
    threads: int,
    *,
    as_points: bool = True,
    held: bool = True,
) -> tuple[Relief, LinePoints]:
    """Fit lines to the events, move points by them, and add the lines that are surer than points.

    Parameters
    ----------
    field : EvidenceField
        Events.
    found : Relief
        Points, and the surface by polarity that they were taken from.
    rays : callable
        Takes a polarity and gives its rays, float32, shape (n, 4); see `fit_lines`.
    columns : tuple of int
        First column in which lines are wanted, and the one after the last.
    settings : EdgeDriftSettings
        The instrument's drift of edges; without one, lines are as uncertain as it may be large.
    light : TravellingLight
        What the pass says of its light; takes these lines too.
    blind_m : float
        Travel of the sensor while pixels are blind after an event, m; 0 where that doesn't matter.
    threads : int
        Threads that share the work.
    as_points : bool
        Whether lines that are surer than the points beside them become points, where light stands
        still.
    held : bool
        Whether lines whose contrast changes faster than on any gauge drift no further for it. With
        `focus` close walls, of which a window tells little else, would follow them too far.

    Returns
    -------
    Relief
        Its `column` may lie between pixels. All points of `found` come first, in their order.
    LinePoints
        All lines.
    """
    both: list[Lines] = [NO_LINES, NO_LINES]

    def fit(polarity: int) -> None:
        scales = (field.offset_per_m, field.ray_slope_scale)
        if np.isfinite(found.surfaces[polarity]).any():
            both[polarity] = fit_lines(rays(polarity), found.surfaces[polarity], columns, *scales)

    share(threads, 2, fit)
    parts = [_judge(lines, k, found, field) for k, lines in enumerate(both)]
    for _, lines in parts:
        light.add(*_crossing(lines, field), lines.events * INDEPENDENT)
    offsets, sigmas, tilts, unsure = [], [], [], []
    for k, (points, lines) in enumerate(parts):
        if settings.calibrated:
            # That of the points stays as it is: where it is off, they lie beside the evidence.
            change = held_change(settings, k, points.change) if held else points.change
            height, drift = edge_drift(
                settings, k, points.slope, change, points.side, field.speed_m_s
            )
            most = np.abs(height) + drift
            wide = drift_of_wider(settings, k, points.slope, points.width_m, most)
        else:
            height = np.zeros(len(lines))
            drift = np.full(len(lines), light.share * _UNKNOWN_DRIFT_M)
            wide = np.zeros(len(lines))
        steep = np.maximum(np.abs(points.slope), _LEAST_SLOPE)
        unsure.append(np.hypot(wide, _WAKES * blind_m * steep))
        offsets.append(points.offset + height * field.offset_per_m)
        sigmas.append(np.hypot(points.sigma_m, drift) * abs(field.offset_per_m))
        tilts.append(lines.tilt)
    every = LinePoints(
        **{
            name: np.concatenate([getattr(points, name) for points, _ in parts])
            for name in LinePoints.__dataclass_fields__
        }
    )
    if not settings.calibrated:
        found = _unsure(found, light.share * _POINT_DRIFT_M * abs(field.offset_per_m))
    # A pixel that is blind for long tells one event of a wall: in one polarity, as a line does, and
    # whether events get denser, as where light travels, doesn't show.
    unknown = 0.0 if settings.calibrated or not blind_m else 1.0 - light.share
    unknown *= _UNKNOWN_DRIFT_M
    if not len(every.row):
        return _unsure(found.whole(), unknown * abs(field.offset_per_m)), every
    offset, sigma, tilt = (np.concatenate(values) for values in (offsets, sigmas, tilts))
    told = sigma * (1.0 + _ONE_SIDED * light.share)
    found = _moved(found, every, offset, told, abs(field.offset_per_m))
    # Where light travels, the points around know of both polarities what a line knows of one.
    if as_points and light.share < 1.0:
        found = _with_lines(found, every, offset, sigma / (1.0 - light.share), tilt)
    found = _unsure(found.whole(), unknown * abs(field.offset_per_m))
    shared = np.concatenate(unsure) * abs(field.offset_per_m)
    return _less_sure(found, every, shared) if shared.any() else found, every


def _unsure(found: Relief, by: float) -> Relief:
    """Points all less sure."""
    return replace(found, sigma=np.hypot(found.sigma, np.float32(by)))


def _judge(
    lines: Lines, polarity: int, found: Relief, field: EvidenceField
) -> tuple[LinePoints, Lines]:
    """What a line's drift depends on, and its uncertainty without drift."""
    n, per_m, surface = len(lines), field.offset_per_m, found.surfaces[polarity]
    slope, change, side, sigma = np.empty((4, n))
    mean, spread = _crossing(lines, field)
    kernels._judge(
        lines.row, lines.x, lines.offset, lines.variance[:, 2], surface, found.changes[polarity],
        found.side, (field.slope_per_px, 1.0 / per_m), (_DOUBT, _LEAST_SLOPE, _PLACE_M, _FLOOR_M),
        slope, change, side, sigma,
    )  # fmt: skip
    points = LinePoints(
        lines.row.astype(np.float64), lines.x, lines.offset, np.full(n, polarity), slope,
        mean / spread, change, side, sigma, lines.band * abs(field.ray_slope_scale / per_m),
        np.full(n, field.speed_m_s),
    )  # fmt: skip
    return points, lines


def _crossing(lines: Lines, field: EvidenceField) -> tuple[F64, F64]:
    """Mean of each line's ray slopes from the middle of the aperture, and their variance."""
    scale = field.ray_slope_scale
    cell = np.clip((lines.x / CELL_PX).astype(np.int64), 0, len(field.middles) - 1)
    return (lines.lean - field.middles[cell]) * scale, lines.spread * scale**2


def _less_sure(found: Relief, lines: LinePoints, sigma: F64) -> Relief:
    """Points as unsure as the lines around are for what both can't know."""
    counts, shape = np.stack([np.ones(len(sigma)), sigma**2]), found.surfaces[0].shape
    around = _around(lines, counts, shape, found.row, found.column)
    unsure = found.sigma.copy()
    kernels._add_variance(found.row, found.column, around, unsure)
    return replace(found, sigma=unsure)


def _moved(found: Relief, lines: LinePoints, offset: F64, sigma: F64, per_m: float) -> Relief:
    """Points moved as the lines around say, as far as those are surer.

    What a neighbourhood's height is off by, it is off by at the line too. Where lines say
    different things, as at the foot and the top of a wall, points are as unsure as those differ.
    """
    shape = found.surfaces[0].shape
    row, column = _pixels(lines, shape)
    before = np.stack([surface[row, column] for surface in found.surfaces])
    move = offset - before[lines.polarity, np.arange(len(row))]
    # A line may lie just beyond the surface that it was fitted from: it moves nothing.
    known = np.isfinite(move)
    move, weight = np.where(known, move, 0.0), np.where(known, 1.0 / sigma**2, 0.0)
    # From the grid's middle, so that float32 tells squares of places apart.
    middle = 0.5 * shape[1]
    x, by = lines.column - middle, weight * move
    sums = np.stack([weight, by, by * move, weight * x, weight * x**2, by * x])
    around = _around(lines, sums, shape, found.row, found.column)
    # A line in the middle of the neighbourhood counts in full, with what height changes over it.
    peak, floor = np.sqrt(2 * np.pi) * _SHARED_PX / kernels.GRID_PX, (_CHANGES_M * per_m) ** 2
    limits = middle, _STIFF_PX**2, peak, floor
    moved, unsure = np.empty(len(found.row)), np.empty(len(found.row), np.float32)
    kernels._move(found.row, found.column, found.offset, found.sigma, around, limits, moved, unsure)
    return replace(found, offset=moved, sigma=unsure)


def _pixels(lines: LinePoints, shape: tuple[int, ...]) -> tuple[I64, I64]:
    """Rows and columns of the pixels that lines lie in."""
    column = np.rint(lines.column).astype(np.int64).clip(0, shape[1] - 1)
    return lines.row.astype(np.int64), column


def _around(
    lines: LinePoints, values: F64, shape: tuple[int, ...], row: np.ndarray, column: np.ndarray
) -> F32:
    """Values of lines, shape (values, n), over a neighbourhood, on a grid of `GRID_PX`.

    0 but for what lies around the places `row`, `column`.
    """
    rows, columns = (-(-size // kernels.GRID_PX) for size in shape)
    sums = np.zeros((rows, columns, len(values)), np.float32)
    kernels._add_lines(*_pixels(lines, shape), values, sums)
    along, down = np.sqrt((_SHARED_PX / kernels.GRID_PX) ** 2 - np.array(kernels.WIDER))
    around = np.zeros_like(sums)
    if len(row):
        box = _box_near(row, down), _box_near(column, along)
        around[box] = cv2.GaussianBlur(sums[box], (0, 0), sigmaX=along, sigmaY=down)
    return around


def _box_near(place: np.ndarray, sigma: float) -> slice:
    """Cells of `GRID_PX` that a Gaussian of them takes in at places, between two cells each."""
    first, last = (int(end) // kernels.GRID_PX for end in (place.min(), place.max()))
    reach = int(4 * sigma) + 2
    return slice(max(first - reach, 0), last + reach + 2)


def _with_lines(found: Relief, lines: LinePoints, offset: F64, sigma: F64, tilt: F64) -> Relief:
    """Points, and lines that are surer than those beside them.

    A line's height is the mean of both by what each is sure of. The points beside it stay: they
    have been moved by it, err hardly more, and without them edges would be thinner.
    """
    shape, room = found.surfaces[0].shape, ROW_STEP * len(offset)
    point = np.full(shape, -1, np.int32)
    point[found.row, found.column] = np.arange(len(found.row), dtype=np.int32)
    line, row, other = (np.empty(room, np.int64) for _ in range(3))
    column, sure = np.empty(room), np.empty(room + 1, np.float32)
    count = kernels._surer(
        lines.row.astype(np.int64), lines.column, tilt, sigma, ROW_STEP, _SAME_PX, point,
        found.sigma, found.confidence, np.full(shape, np.inf), line, row, column, other, sure,
    )  # fmt: skip
    line, row, column, other = line[:count], row[:count], column[:count], other[:count]
    own, best = sigma[line], found.sigma[other].astype(np.float64)
    both = _ALIKE * own * best
    share = np.minimum((best**2 - both) / (own**2 + best**2 - 2 * both), 1.0)
    left = (share * own) ** 2 + ((1 - share) * best) ** 2 + 2 * share * (1 - share) * both
    height = share * offset[line] + (1 - share) * found.offset[other]
    return replace(
        found,
        row=np.concatenate([found.row, row]),
        column=np.concatenate([found.column, column]),
        offset=np.concatenate([found.offset, height]),
        confidence=np.concatenate([found.confidence, sure[:count]]),
        sigma=np.concatenate([found.sigma, np.sqrt(left)]).astype(np.float32),
        agreed=np.concatenate([found.agreed, np.ones(count)]).astype(np.float32),
        one_sided=np.concatenate([found.one_sided, found.one_sided[other]]),
    )
