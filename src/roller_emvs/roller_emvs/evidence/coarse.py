"""Where to search: the depth that parts of the aperture agree on, each for itself."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64
from roller_emvs.bands import Bands
from roller_emvs.rays import F32
from roller_emvs.threads import share

from . import _peak_kernels as peaks
from ._kernels import CELL_PX
from .blur import blurred
from .field import EvidenceField, RayField
from .focus_measure import (
    Sorted,
    by_part,
    everywhere,
    focus_measure_by_plane,
    plane_offsets,
    tiles_reached,
)

#: Neighbourhood of the coarse depth, px.
_SIGMA_PX = 8.0
#: Where the coarse depth has less confidence, as in noise or where several depths fit alike, there
#: is no depth. Tuned on the virtual cell.
_MIN_CONFIDENCE = 0.2


def coarse_planes(field: EvidenceField, low: float, high: float, parts: int, per_px: float) -> F64:
    """Planes that a part's parallax tells apart."""
    parallax = field.aperture * (high - low) / parts
    return plane_offsets(low, high, parallax, per_px)


def coarse_offset(field: RayField, bands: list[Bands], at: F64, parts: int, threads: int) -> F32:
    """Offset on cells from the sum of the parts' evidence; NaN where none is found.

    Parameters
    ----------
    field : RayField
        Rays of a window or block.
    bands : list of Bands
        The rays of OFF and of ON events, sorted for at least the planes.
    at : ndarray of float64, shape (planes,)
        Their offsets.
    parts : int
        Parts of the aperture.
    threads : int
        Threads that share the work.
    """
    polarities = len(bands)
    least, most = float(field.slopes[0].min()), float(field.slopes[1].max())
    width = max(most - least, 1e-12) / parts
    rays: list[Sorted | None] = [None] * polarities
    found: list[F32 | None] = [None] * (polarities * parts)

    def arrange(polarity: int) -> None:
        rays[polarity] = by_part(bands[polarity], least, width, parts)

    def look(k: int) -> None:
        own, part = rays[k // parts], k % parts
        assert own is not None
        begins, ends = own.starts[:, part], own.starts[:, part + 1]
        if (begins < ends).any():
            chosen = everywhere(own.rays, begins, ends, len(at))
            tiles = tiles_reached(chosen, field, at)
            found[k] = focus_measure_by_plane(chosen, field, at, len(at), tiles)

    share(threads, polarities, arrange)
    share(threads, polarities * parts, look)
    total = np.zeros((len(at), *field.cells), np.float32)
    for measure in found:
        if measure is not None:
            total += measure
    return offset_of_parts(total, at)


def offset_of_parts(measure: F32, at: F64, weakest: float = 0.0) -> F32:
    """Offset on cells from the sum of the parts' focus measure; NaN where none is found.

    Parameters
    ----------
    measure : ndarray of float32, shape (planes, rows, columns)
        The sum.
    at : ndarray of float64, shape (planes,)
        Offsets of the planes.
    weakest : float
        Measure, summed over a neighbourhood, from which on there is one; see `measure_of_spots`.
    """
    cells = measure.shape[1:]
    peak, contrast, top = (np.empty(cells, np.float32) for _ in range(3))
    scores = blurred(measure, _SIGMA_PX / CELL_PX)
    first, last = np.zeros(cells, np.int32), np.full(cells, len(at) - 1, np.int32)
    peaks._find_peak(scores, first, last, 2.0, weakest, _MIN_CONFIDENCE, peak, contrast, top)
    return (at[0] + peak * (at[1] - at[0])).astype(np.float32)


def measure_of_spots(spots: float, votes: float) -> float:
    """What so many spots of so many votes come to, summed over a neighbourhood of this module."""
    return spots * votes**2 / (2 * np.pi * (_SIGMA_PX / CELL_PX) ** 2)
