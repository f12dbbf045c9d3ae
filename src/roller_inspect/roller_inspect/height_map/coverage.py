"""How much of an area was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roller_core.transforms import F64

from .height_map import CONTINUED, F32, MEASURED, OUTSIDE, U8, Bools, HeightMap


@dataclass(frozen=True)
class Coverage:
    """Shares of an area, 0–1; they add up to 1 unless the area is empty."""

    #: Shares.
    measured: float = 0.0
    continued: float = 0.0
    unmeasured: float = 0.0
    #: The area.
    area_m2: float = 0.0
    #: Measured points over it.
    points_per_mm2: float = 0.0
    #: Share of the area that the scan reached.
    scanned: float = 1.0
    #: Share that was measured, whether or not a reference goes so far; None: `measured`.
    seen: float | None = None

    @property
    def texture(self) -> float:
        """Measured share of what the scan reached, whatever it was compared with."""
        seen = self.measured if self.seen is None else self.seen
        return min(seen / self.scanned, 1.0) if self.scanned else 0.0


#: A scan that measures less of cells so large, m, proves nothing by finding nothing. With 18 % of
#: the virtual cell's clean plate measured, 14 of 15 defects 100 µm deep are found, with 13 % 11,
#: with 8 % 7. With another generator, less noisy, 13 % found all 22.
LEAST_TEXTURE, _CELL_M = 0.15, 1e-4


def textured(coverage: Coverage, grid_m: float) -> bool:
    """Whether a scan shows enough texture, where it came, whatever the map's grid.

    Parameters
    ----------
    coverage : Coverage
        Of an area.
    grid_m : float
        Edge of the cells that it was counted in, which may be finer than those of a long map.
    """
    if not coverage.scanned:
        return False
    return bool(1 - (1 - coverage.texture) ** ((_CELL_M / grid_m) ** 2) >= LEAST_TEXTURE)


def coverage_of(
    height_map: HeightMap, area: Bools | None = None, shares: F32 | None = None
) -> Coverage:
    """Coverage of a map, or of an area of it.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    area : ndarray of bool, shape (ny, nx), optional
        Cells that count, those outside the scan too; without it all that the scan reached.
    shares : ndarray of float32, shape (4, ny, nx), optional
        Of cells by state (`shares`); without them a cell is what its state says.
    """
    inside: Bools
    if area is not None:
        inside = area
    else:
        inside = height_map.state != OUTSIDE if shares is None else np.any(shares > 0, axis=0)
    counts = counts_of(height_map.state[inside], None if shares is None else shares[:, inside])
    if area is None:
        counts[OUTSIDE] = 0.0
    cell_m2 = height_map.step_m**2
    points = float(height_map.points[inside].sum(dtype=np.float64))
    return coverage_of_counts(
        counts, cell_m2, points / max(float(counts.sum()) * cell_m2 * 1e6, 1e-12)
    )


def counts_of(state: U8, shares: F32 | None = None) -> F64:
    """Cells by state, shape (4,), of some with a state (n,), and perhaps shares (4, n)."""
    if shares is None:
        return np.bincount(state, minlength=4).astype(np.float64)
    unmeasured, continued, measured, bare = shares.sum(axis=1, dtype=np.float64)
    inside = unmeasured + bare, continued, measured
    return np.array([max(len(state) - sum(inside), 0.0), *inside])


def coverage_of_counts(counts: F64, cell_m2: float, points_per_mm2: float) -> Coverage:
    """Coverage by an area's cells of each state, shape (4,); those outside the scan count."""
    total = float(counts.sum())
    if not total:
        return Coverage()
    shares = counts / total
    measured, continued = float(shares[MEASURED]), float(shares[CONTINUED])
    rest = max(1.0 - measured - continued, 0.0)
    reached = 1.0 - float(shares[OUTSIDE])
    return Coverage(measured, continued, rest, total * cell_m2, points_per_mm2, reached)
