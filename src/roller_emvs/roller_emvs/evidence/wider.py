"""Points of a textured surface by a wider neighbourhood, where that sees no relief.

Under a printed texture depths lie everywhere, and a flat place can be the mean of more of them than
a flank, which a wide neighbourhood levels. How wide a neighbourhood may be is told by what it
leaves over: as long as that is noise, it has levelled nothing (adaptive bandwidth after Lepski,
*Theory Probab. Appl.* 35, 1990; here of two widths, and without a step between them).
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from roller_core.transforms import F64
from roller_emvs.rays import F32

from ._kernels import CELL_PX
from .blur import blurred
from .evidence_settings import EvidenceSettings
from .field import EvidenceField
from .fit import fit_planes
from .relief import Relief, enlarge
from .surface_slope import RESOLUTION_PX
from .sweep import Depths

#: Wider neighbourhood, px. From 16 to 24 points err the same within 3 %.
_WIDER_PX = 20.0
#: Of what planes leave over, all is put back: a surface that bends evenly isn't levelled then.
_GIVEN_BACK = 1.0
#: Neighbourhood over which the mean of what points lack of the wider surface is taken, and relief
#: is where it, or what is beside it, is so many times the usual.
_LOOK_CELLS, _RELIEF = 1.5, 2.0
_BESIDE = np.ones((3, 3), np.uint8)
#: Share of the cells with relief from which on all points stay: what is between is no flat place.
#: On plates with dents 0.06 to 0.25, on stairs 1 mm apart 0.32 to 0.36.
_MOST_RELIEF = 0.3
#: As far as the wider surface reaches, two of its deviations, it errs by strong relief.
_REACHED = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (int(4 * _WIDER_PX / CELL_PX) + 1,) * 2)
#: The usual is told from the quietest cells, this share of them, as others may be of relief: so
#: many deviations a share of 0.1 of a normal distribution lies within. At most it is so much of the
#: sigma of the surest points: where a surface is relief all over, none of it is noise.
_QUIET, _QUIET_DEVIATIONS, _USUAL = 0.1, 0.1257, 0.6
#: Share of its sigma that a point is surer by where it follows. Deviations fall by a third there,
#: but what poses err by stays, which points around err by too.
_SURER = np.float32(0.2)


def follow_wider(
    found: Relief, field: EvidenceField, settings: EvidenceSettings, threads: int = 1
) -> Relief:
    """Points that follow the surface of a wider neighbourhood as far as they tell no relief.

    Parameters
    ----------
    found : Relief
        Points, on whole pixels.
    field : EvidenceField
        The grid that they are of.
    settings : EvidenceSettings
        `strong_relief`.
    threads : int
        Threads that share the work.
    """
    if not len(found.row):
        return found
    row, column = found.row, found.column
    cell = row // CELL_PX * field.cells[1] + column // CELL_PX
    size = field.cells[0] * field.cells[1]
    count = np.bincount(cell, minlength=size).reshape(field.cells)
    known = count > 0

    def mean(values: F64) -> F32:
        sums = np.bincount(cell, values, size).reshape(field.cells)
        return (sums / np.maximum(count, 1)).astype(np.float32)

    weight, nothing = known.astype(np.float32), np.zeros(field.cells, np.float32)
    x, y = ((place + 0.5) / CELL_PX - 0.5 for place in (column, row))
    offset = np.where(known, mean(found.offset), np.float32(np.nan))
    depths = Depths(offset, weight, weight, mean(x), mean(y), nothing)
    resolution = RESOLUTION_PX / max(field.aperture, 1e-12)
    wider = fit_planes(
        [depths], _WIDER_PX / CELL_PX, resolution, threads, scattered=False, given_back=_GIVEN_BACK
    )
    lack = enlarge(wider.offset)[row, column] - found.offset
    weights, sums = blurred(np.stack([weight, mean(lack)]), _LOOK_CELLS)
    around = np.abs(sums) / np.maximum(weights, np.float32(1e-6))
    usual = min(
        float(np.quantile(around[known], _QUIET)) / _QUIET_DEVIATIONS,
        _USUAL * float(np.quantile(found.sigma * found.agreed, _QUIET)),
    )
    if (around[known] > _RELIEF * usual).mean() > _MOST_RELIEF:
        return found
    reached = cv2.dilate((around > settings.strong_relief * usual).view(np.uint8), _REACHED) > 0
    # On either side of a step are both a hollow and a crest, which are none together.
    around = cv2.dilate(around, _BESIDE)
    share = 1.0 / (1.0 + (around / np.float32(max(_RELIEF * usual, 1e-12))) ** 4)
    share = np.where(known & ~reached, share, np.float32(0)).astype(np.float32)
    follows = enlarge(share)[row, column]
    sigma = found.sigma * (1 - _SURER * follows)
    return replace(found, offset=found.offset + follows * lack, sigma=sigma)
