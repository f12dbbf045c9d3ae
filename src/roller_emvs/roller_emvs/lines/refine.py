"""Lines by the events of a field, less their drift, and what points learn from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from roller_core.transforms import F64
from roller_emvs.evidence import CELL_PX, EvidenceField, Relief
from roller_emvs.threads import share

from . import _place_kernels as kernels
from .edge_drift import EdgeDriftSettings, drift_of_wider, edge_drift, held_change
from .fit import INDEPENDENT, NO_LINES, ROW_STEP, TEXTURE_ROW_STEP, Lines, fit_lines
from .follow import add_lines, move_points, widen_sigma
from .line_points import LinePoints
from .ray_source import RaySource
from .travelling_light import TravellingLight

#: Uncertainty of a line's place that its fit doesn't know of, m: the poses' stamps and noise.
_PLACE_M = 1.5e-5
#: Least slope at a line: where one polarity alone shows a wall, the surface around shows none.
_LEAST_SLOPE = 0.6
#: Share of what line and neighbourhood differ by that stays in doubt.
_DOUBT = 1 / 3
#: Least uncertainty of a line's height, m.
_FLOOR_M = 1.2e-5
#: The level from which a pixel tells an edge is that where it woke up after the one before, and
#: hangs on that: the place is unsure by so much of the travel meanwhile.
_WAKES = 0.15
#: Drift of lines, where light travels and nothing is calibrated, and what of it a neighbourhood of
#: both polarities errs by, m. Tuned on the virtual cell.
_UNKNOWN_DRIFT_M, _POINT_DRIFT_M = 1.3e-4, 8e-5
#: Where light travels, what drift a line has hangs on its own polarity and wall, of which a
#: calibration knows little: to the points around it is less sure by this share.
_ONE_SIDED = 0.5


def refine(
    field: EvidenceField,
    found: Relief,
    rays: Callable[[int], RaySource],
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
        Takes a polarity and gives its `RaySource`.
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
    row_step = TEXTURE_ROW_STEP if found.textured else ROW_STEP

    def fit(polarity: int) -> None:
        scales = (field.offset_per_m, field.ray_slope_scale, field.direction)
        if np.isfinite(found.surfaces[polarity]).any():
            both[polarity] = fit_lines(
                rays(polarity), found.surfaces[polarity], columns, *scales, row_step
            )

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
    # A line tells of the rows up to the next: of fewer lines each counts for more.
    told = sigma * (1.0 + _ONE_SIDED * light.share) * np.sqrt(ROW_STEP / row_step)
    found = move_points(found, every, offset, told, abs(field.offset_per_m))
    # Where light travels, the points around know of both polarities what a line knows of one.
    if as_points and light.share < 1.0:
        found = add_lines(found, every, offset, sigma / (1.0 - light.share), tilt)
    found = _unsure(found.whole(), unknown * abs(field.offset_per_m))
    shared = np.concatenate(unsure) * abs(field.offset_per_m)
    return widen_sigma(found, every, shared) if shared.any() else found, every


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
