"""From depths on a grid to points: the local plane through them, and support by events."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from roller_core.transforms import F64
from roller_emvs.lines.edge_drift import EdgeDriftSettings
from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _fit_kernels as kernels
from . import _pixel_kernels as pixels
from ._kernels import CELL_PX
from .evidence_settings import EvidenceSettings
from .field import Box, EvidenceField, Mask
from .islands import without_islands
from .surface_slope import (
    RESOLUTION_PX,
    SLOPE_SIGMA_PX,
    STILL_SIGMA_PX,
    evened_changes,
    surface_fit,
    surface_slope,
    wall_side,
    without_drift,
)
from .sweep import Depths
from .uncertainty import agreed_share, point_sigma, seen_around

#: Neighbourhood whose mean a pixel's support must exceed, cells.
_AROUND = 9
#: What holds less than this share of the support of an edge near it along the row is that edge's
#: fringe: its events where they meet a surface that doesn't follow it.
_FRINGE = 0.15
#: Scatter from which on the depths around a place give none, pixels of parallax.
_MOST_SCATTER_PX = 1.5
#: Warped events that a pixel needs to become a point.
_MIN_VOTES = np.float32(2.0)
#: Share of cells with depths of both polarities from which on a grid counts as textured: at first,
#: and once one was, as a print is on the skin and goes on at the ends of a plate.
_TEXTURED, _STILL_TEXTURED = 0.9, 0.45
#: Cells around depths up to which they tell on the surface.
_REACH = 8


@dataclass(frozen=True)
class Relief:
    """Measured pixels of a grid."""

    #: Pixels. Shape (n,).
    row: np.ndarray
    column: np.ndarray
    #: Parameter of the plane that the surface lies on there. Shape (n,).
    offset: F64
    #: 0–1. Shape (n,).
    confidence: F32
    #: Standard uncertainty of the offset of each by itself, and the share of it that is left by how
    #: those around agree; see `agreed_share`. Shape (n,).
    sigma: F32
    agreed: F32
    #: What `sigma` lacks where one polarity alone is seen, whose drift the lines around share.
    one_sided: F32
    #: The surface by pixel where OFF and where ON events have a depth, NaN elsewhere. Shape
    #: (height, width).
    surfaces: tuple[F32, ...]
    #: Of the cells of each, see `crossing_change`. Shape (rows, columns).
    changes: tuple[F32, ...]
    #: Of the cells, see `wall_side`; 0 where nothing asks for it. Shape (rows, columns).
    side: F32
    #: Whether its edges are a texture's, see `is_textured`.
    textured: bool = False

    def whole(self) -> Relief:
        """The same with `one_sided` in `sigma`, once lines have moved the points."""
        sigma = np.hypot(self.sigma, self.one_sided)
        return replace(self, sigma=sigma, one_sided=np.zeros_like(self.one_sided))

    def put(self, field: EvidenceField, box: Box, surfaces: bool) -> Relief:
        """The same as part of a larger grid, elsewhere without points; see `measured_pixels`."""
        rows, columns = box
        top, left = CELL_PX * rows.start, CELL_PX * columns.start
        if not surfaces:
            return replace(self, row=self.row + top, column=self.column + left)
        px = slice(top, CELL_PX * rows.stop), slice(left, CELL_PX * columns.stop)

        def whole(part: F32, shape: tuple[int, int], at: Box, fill: float) -> F32:
            out = np.full(shape, np.float32(fill))
            out[at] = part
            return out

        return replace(
            self,
            row=self.row + top,
            column=self.column + left,
            surfaces=tuple(whole(v, field.shape, px, np.nan) for v in self.surfaces),
            changes=tuple(whole(v, field.cells, box, 0.0) for v in self.changes),
            side=whole(self.side, field.cells, box, 0.0),
        )


def is_textured(depths: list[Depths], before: bool) -> bool:
    """Whether edges lie so close, as under a printed texture, that neighbourhoods tell all.

    `before`: whether they did elsewhere in this run.
    """
    known = np.isfinite([found.offset for found in depths])
    return bool(known.all(axis=0).mean() >= (_STILL_TEXTURED if before else _TEXTURED))


def measured_pixels(
    field: EvidenceField,
    depths: list[Depths],
    settings: EvidenceSettings,
    drift: EdgeDriftSettings,
    threads: int = 1,
    sides: bool = False,
    surfaces: bool = True,
    textured: bool = False,
    everywhere: bool = False,
) -> Relief:
    """Pixels on which events of one polarity gather, and the surface there.

    Parameters
    ----------
    field : EvidenceField
        Events.
    depths : list of Depths
        Of OFF and of ON events.
    settings : EvidenceSettings
        `min_point_confidence`.
    drift : EdgeDriftSettings
        The instrument's drift of edges, which is taken out if it is calibrated.
    threads : int
        Threads that share the work.
    sides : bool
        Whether `side` is wanted though the drift doesn't depend on it.
    surfaces : bool
        Whether `surfaces`, `changes` and `side` are wanted of the whole grid, not of a part of it.
    textured : bool
        Whether the edges are a texture's, see `is_textured`, whose drift the slope doesn't tell.
    everywhere : bool
        Whether the depths were searched for on all planes, see `without_islands`.
    """
    if not any(np.isfinite(found.offset).any() for found in depths):
        return _nothing(field)
    if textured and drift.calibrated:
        drift = drift.under_texture()
    depths = [without_islands(field, found, everywhere) for found in depths]
    cut = field.cut_around(_near(depths), _REACH)
    if cut is None:
        return _measured(field, depths, settings, drift, threads, sides, textured)
    part, box = cut
    own = [each.cut(box) for each in depths]
    found = _measured(part, own, settings, drift, threads, sides, textured)
    return found.put(field, box, surfaces)


def _near(depths: list[Depths]) -> Mask:
    """Cells that have a depth, or hold the evidence of one."""
    cells = np.zeros(depths[0].offset.shape, np.bool_)
    for found in depths:
        kernels._mark(found.offset, found.x, found.y, cells)
    return cells


def _measured(
    field: EvidenceField,
    depths: list[Depths],
    settings: EvidenceSettings,
    drift: EdgeDriftSettings,
    threads: int,
    sides: bool,
    textured: bool,
) -> Relief:
    changes = tuple(found.change for found in depths)
    px_per_offset = max(field.aperture, 1e-12)
    sigma_px = SLOPE_SIGMA_PX if drift.corrects else STILL_SIGMA_PX
    fit, slope = surface_slope(field, depths, threads, not drift.calibrated, sigma_px)
    side = np.zeros(field.cells, np.float32)
    if sides or drift.sided:
        side = wall_side(depths)
    if drift.calibrated:
        own = evened_changes(depths) if textured else depths
        depths, unsure = without_drift(field, own, slope, side, drift)
        fit = surface_fit(field, depths, sigma_px, threads, like=fit)
    nowhere = np.float32(np.nan)
    cells = [np.where(np.isfinite(found.offset), fit.offset, nowhere) for found in depths]
    scatter_px = fit.scatter * np.float32(px_per_offset)
    surfaces, support = ([np.empty((0, 0), np.float32)] * 2 for _ in range(2))
    around, spans = np.empty((2, *field.cells), np.float32), np.empty((field.cells[0], 2), np.int64)
    pixels._spans(*cells, spans)

    def gather(polarity: int) -> None:
        surfaces[polarity] = enlarge(cells[polarity])
        support[polarity] = field.support(surfaces[polarity], polarity)
        pixels._cell_means(support[polarity], spans, around[polarity])
        cv2.blur(around[polarity], (_AROUND, _AROUND), dst=around[polarity])

    share(threads, 2, gather)
    which = np.empty(field.shape, np.uint8)
    a, b, c, d = np.empty((4, field.shape[1] + 2 * pixels.NEAR_PX), np.float32)
    count = pixels._choose(
        support[0], around[0], support[1], around[1], _MIN_VOTES, spans, (a, b, c, d), which
    )
    pixels._drop_fringe(support[0], support[1], _FRINGE, spans, (a, b), which)
    row, column = (np.empty(count, np.int64) for _ in range(2))
    offset, sure, spread_px = (np.empty(count, np.float32) for _ in range(3))
    confidences = tuple(found.confidence for found in depths)
    limits = (RESOLUTION_PX, _MOST_SCATTER_PX, settings.min_point_confidence)
    count = pixels._take(
        which, spans, tuple(surfaces), confidences, scatter_px, limits, row, column, offset, sure,
        spread_px,
    )  # fmt: skip
    row, column, offset = row[:count], column[:count], offset[:count]
    sure, spread_px, seen = sure[:count], spread_px[:count], seen_around(depths)
    sigma = point_sigma(field, fit.offset, row, column, spread_px, seen)
    one_sided = np.zeros(len(sigma), np.float32)
    if drift.calibrated:
        # The surface is between those of both polarities, which err apart; where one alone is
        # seen, it errs as that does.
        cell = row // CELL_PX * field.cells[1] + column // CELL_PX
        left, whole = (np.hypot(*part) for part in (0.5 * unsure, fit.shares * unsure))
        sigma = np.hypot(sigma, left.ravel()[cell])
        one_sided = np.sqrt(np.maximum(whole**2 - left**2, 0)).ravel()[cell]
    agreed = np.ones(len(sigma), np.float32)
    if not drift.sided:  # by its side both polarities of a wall drift alike
        agreed = agreed_share(field, fit.offset, row, column, spread_px, seen, sigma)
    heights = offset.astype(np.float64)
    return Relief(
        row, column, heights, sure, sigma, agreed, one_sided, tuple(surfaces), changes, side,
        textured,
    )  # fmt: skip


def _nothing(field: EvidenceField) -> Relief:
    """No pixels."""
    none, place = np.empty(0, np.float32), np.empty(0, np.int64)
    unknown, zero = np.full(field.shape, np.float32(np.nan)), np.zeros(field.cells, np.float32)
    return Relief(
        place,
        place,
        none.astype(np.float64),
        none,
        none,
        none,
        none,
        (unknown, unknown),
        (zero, zero),
        zero,
    )


def enlarge(values: F32) -> F32:
    """From cells to pixels, bilinear."""
    size = (values.shape[1] * CELL_PX, values.shape[0] * CELL_PX)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)
