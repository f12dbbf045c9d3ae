"""The choices of parameters that a calibration tries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from typing import Any

import numpy as np

from roller_core.errors import SettingsError
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings

#: How far weights may be off a sum of one.
SIMPLEX_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Grid:
    """Choices that are tried, each value with each."""

    #: Values that are tried, by their parameter's name in `DepthSettings`.
    ranges: Mapping[str, Any]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each parameter."""
        return tuple(len(values) for values in self.ranges.values())

    @property
    def size(self) -> int:
        """Number of choices."""
        return int(np.prod(self.shape))

    def of_settings(self, settings: DepthSettings) -> Grid:
        """The one choice that settings make."""
        return Grid({name: [reduce(getattr, name.split("."), settings)] for name in self.ranges})

    def values(self, choice: int) -> dict[str, Any]:
        """Parameters of a choice."""
        at = np.unravel_index(choice, self.shape)
        chosen = zip(self.ranges.items(), at, strict=True)
        return {name: np.round(values[int(k)], 6).tolist() for (name, values), k in chosen}

    def at_border(self, choice: int) -> list[str]:
        """Parameters of a choice that lie at an end of their range, by name."""
        at = np.unravel_index(choice, self.shape)
        return [
            name
            for (name, values), k in zip(self.ranges.items(), at, strict=True)
            if np.isscalar(values[0]) and len(values) > 2 and k in (0, len(values) - 1)
        ]


def focus_grid(
    sigmas_px: Sequence[float] = (3.0, 4.0, 5.0, 6.0, 8.0),
    confidences: Sequence[float] = (0.2, 0.3, 0.4, 0.5, 0.6),
) -> Grid:
    """Choices for `focus`: neighbourhoods, px, and least confidences, which a sphere determines."""
    return Grid({"focus.sigma_px": sigmas_px, "focus.min_confidence": confidences})


def paper_grid(
    weights: F64,
    thresholds: Sequence[float] = tuple(map(float, range(5, 21))),
    medians_px: Sequence[int] = tuple(range(11, 92, 2)),
) -> Grid:
    """Choices for the paper's method.

    Parameters
    ----------
    weights : ndarray of float64, shape (n, views)
        On the simplex.
    thresholds : sequence of float
        C, in 1/255.
    medians_px : sequence of int
        G_f, odd, px.
    """
    return Grid(
        {"paper.threshold_c": thresholds, "paper.median_px": medians_px, "paper.weights": weights}
    )


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
