"""Depths of neighbourhoods in the form of lines: where no line fits, drift is found from them."""

from __future__ import annotations

import numpy as np

from roller_emvs.evidence import CELL_PX, Depths, EvidenceField
from roller_emvs.evidence.slope_statistics import slope_statistics
from roller_emvs.evidence.surface_slope import evened_changes, surface_slope, wall_side
from roller_emvs.evidence.uncertainty import point_sigma, seen_around

from .line_points import LinePoints


def depth_points(
    field: EvidenceField, depths: list[Depths], columns: tuple[int, int], textured: bool = False
) -> LinePoints:
    """Depths of the cells of both polarities, each where its evidence lies.

    Parameters
    ----------
    field : EvidenceField
        Events.
    depths : list of Depths
        Of OFF and of ON events, drift and all.
    columns : tuple of int
        First column in which they are wanted, and the one after the last.
    textured : bool
        Whether the edges are a texture's: their change of contrast is that of those around.
    """
    fit, slopes = surface_slope(field, depths)
    side, around = wall_side(depths), seen_around(depths)
    depths = evened_changes(depths) if textured else depths
    scale = field.ray_slope_scale
    low, high = field.slopes * scale
    middle, variance = 0.5 * (low + high), np.maximum((high - low) ** 2 / 12, 1e-12)
    parts = []
    for polarity, found in enumerate(depths):
        i, j = np.nonzero(np.isfinite(found.offset))
        row, column = ((v[i, j] + 0.5) * CELL_PX - 0.5 for v in (found.y, found.x))
        keep = (column >= columns[0]) & (column < columns[1])
        i, j, row, column = i[keep], j[keep], row[keep], column[keep]
        at_row = np.clip(np.rint(found.y[i, j]).astype(np.int64), 0, slopes.shape[0] - 1)
        at = at_row, np.clip(np.rint(found.x[i, j]).astype(np.int64), 0, slopes.shape[1] - 1)
        seen = slope_statistics(field, found.offset, polarity)
        lean = (seen.mean[i, j] * scale - middle[j]) / variance[j]
        px = np.asarray([a * CELL_PX for a in at])
        scatter = fit.scatter[at] * np.float32(max(field.aperture, 1e-12))
        scatter = np.nan_to_num(scatter, nan=1.0)
        sigma = point_sigma(field, fit.offset, px[0], px[1], scatter, around)
        parts.append(
            LinePoints(
                row.astype(np.float64),
                column.astype(np.float64),
                found.offset[i, j].astype(np.float64),
                np.full(len(i), polarity),
                slopes[at],
                lean,
                found.change[i, j].astype(np.float64),
                side[i, j].astype(np.float64),
                sigma.astype(np.float64) / abs(field.offset_per_m),
                np.zeros(len(i)),
                np.full(len(i), field.speed_m_s),
            )
        )
    return LinePoints(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in LinePoints.__dataclass_fields__
        }
    )
