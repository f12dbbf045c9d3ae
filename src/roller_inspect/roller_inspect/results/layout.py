"""Where the panels of a run's picture lie, and which values their colours reach from and to."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

#: Pixels: width of the picture, left and right of the panels, of the scales of colours.
WIDTH, LEFT, RIGHT, SCALE = 1500, 75, 1330, (1380, 1398)
_GAP = 130


def columns(shares: list[int]) -> list[tuple[int, int]]:
    """Left and right of panels beside each other, by their shares of the width."""
    unit = (RIGHT - LEFT - _GAP * (len(shares) - 1)) / sum(shares)
    out, left = [], float(LEFT)
    for share in shares:
        out.append((round(left), round(left + share * unit)))
        left += share * unit + _GAP
    return out


def limits(values: F64) -> tuple[float, float]:
    """The values that all but one of a hundred lie between; 0 and 1 of none."""
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, [0.5, 99.5])
    return float(low), float(max(high, low + 1e-6))
