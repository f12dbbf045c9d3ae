"""The choices of the paper's parameters that a calibration tries."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from roller_core.errors import SettingsError
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings

#: How far weights may be off a sum of one.
SIMPLEX_TOLERANCE = 1e-3


@dataclass(frozen=True)
class PaperGrid:
    """Choices that are tried, each with each.

    Attributes
    ----------
    thresholds : tuple of float
        C, whole numbers, in 1/255.
    medians_px : tuple of int
        G_f, odd, px.
    weights : ndarray of float64, shape (n, views)
        On the simplex.
    """

    thresholds: tuple[float, ...]
    medians_px: tuple[int, ...]
    weights: F64

    @classmethod
    def of_paper(cls, views: int = 3, parts: int = 18) -> PaperGrid:
        """C 5–20, G_f 11–91 odd, weights in so many parts (18 hold the paper's 8, 6 and 4)."""
        return cls(
            tuple(float(c) for c in range(5, 21)), tuple(range(11, 92, 2)), simplex(views, parts)
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of thresholds, medians and weights."""
        return len(self.thresholds), len(self.medians_px), len(self.weights)

    @property
    def size(self) -> int:
        """Number of choices."""
        return int(np.prod(self.shape))

    def values(self, choice: int) -> dict[str, float | int | list[float]]:
        """Parameters of a choice, by their names in `DepthSettings`."""
        c, g, w = np.unravel_index(choice, self.shape)
        return {
            "paper.threshold_c": self.thresholds[c],
            "paper.median_px": self.medians_px[g],
            "paper.weights": [round(float(v), 6) for v in self.weights[w]],
        }

    def at_border(self, choice: int) -> list[str]:
        """Parameters of a choice that lie at an end of their range, by name."""
        c, g, _ = np.unravel_index(choice, self.shape)
        ends = {"paper.threshold_c": (c, self.shape[0]), "paper.median_px": (g, self.shape[1])}
        return [name for name, (k, n) in ends.items() if n > 2 and k in (0, n - 1)]


def simplex(count: int, parts: int) -> F64:
    """All weights that are whole multiples of 1 / parts and sum up to one, shape (n, count)."""
    bars = np.array(list(combinations(range(parts + count - 1), count - 1)), np.int64)
    bars = bars.reshape(len(bars), count - 1)
    padded = np.pad(bars, ((0, 0), (1, 1)), constant_values=((0, 0), (-1, parts + count - 1)))
    return np.asarray((np.diff(padded, axis=1) - 1) / parts, np.float64)


def check_weights(settings: DepthSettings) -> None:
    """Refuse settings whose weights can't be calibrated.

    Raises
    ------
    SettingsError
        If the weights are off the simplex.
    """
    total = sum(settings.paper.weights)
    if abs(total - 1) > SIMPLEX_TOLERANCE:
        raise SettingsError(
            f"weights {list(settings.paper.weights)} sum up to {total:g}, not 1: they must lie "
            "on the simplex"
        )
