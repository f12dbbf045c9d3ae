"""The choices of parameters that a calibration tries."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from roller_core.errors import SettingsError
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings

#: How far weights may be off a sum of one.
SIMPLEX_TOLERANCE = 1e-3


class Grid(ABC):
    """Choices that are tried, each value with each."""

    @property
    @abstractmethod
    def ranges(self) -> Mapping[str, Sequence[Any]]:
        """Values that are tried, by their parameter's name in `DepthSettings`."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each parameter."""
        return tuple(len(values) for values in self.ranges.values())

    @property
    def size(self) -> int:
        """Number of choices."""
        return int(np.prod(self.shape))

    def values(self, choice: int) -> dict[str, Any]:
        """Parameters of a choice."""
        at = np.unravel_index(choice, self.shape)
        return {n: r[int(k)] for (n, r), k in zip(self.ranges.items(), at, strict=True)}

    def at_border(self, choice: int) -> list[str]:
        """Parameters of a choice that lie at an end of their range, by name."""
        at = np.unravel_index(choice, self.shape)
        return [
            name
            for (name, values), k in zip(self.ranges.items(), at, strict=True)
            if np.isscalar(values[0]) and len(values) > 2 and k in (0, len(values) - 1)
        ]


@dataclass(frozen=True)
class FocusGrid(Grid):
    """Choices for `focus`: the parameters that a sphere determines."""

    #: Neighbourhood, px.
    sigmas_px: tuple[float, ...] = (3.0, 4.0, 5.0, 6.0, 8.0)
    #: Least confidence.
    confidences: tuple[float, ...] = (0.2, 0.3, 0.4, 0.5, 0.6)

    @classmethod
    def of_settings(cls, s: DepthSettings) -> FocusGrid:
        """The one choice that settings make."""
        f = s.focus
        return cls((f.sigma_px,), (f.min_confidence,))

    @property
    def ranges(self) -> Mapping[str, Sequence[Any]]:
        """Values by name."""
        return {
            "focus.sigma_px": self.sigmas_px,
            "focus.min_confidence": self.confidences,
        }


@dataclass(frozen=True)
class PaperGrid(Grid):
    """Choices for the paper's method."""

    #: C, whole numbers, in 1/255.
    thresholds: tuple[float, ...]
    #: G_f, odd, px.
    medians_px: tuple[int, ...]
    #: On the simplex. Shape (n, views).
    weights: F64

    @classmethod
    def of_paper(cls, views: int = 3, parts: int = 18) -> PaperGrid:
        """C 5–20, G_f 11–91 odd, weights in so many parts (18 hold the paper's 8, 6 and 4)."""
        return cls(
            tuple(float(c) for c in range(5, 21)), tuple(range(11, 92, 2)), simplex(views, parts)
        )

    @classmethod
    def of_settings(cls, s: DepthSettings) -> PaperGrid:
        """The one choice that settings make."""
        p = s.paper
        return cls((p.threshold_c,), (p.median_px,), np.array([p.weights]))

    @property
    def ranges(self) -> Mapping[str, Sequence[Any]]:
        """Values by name."""
        return {
            "paper.threshold_c": self.thresholds,
            "paper.median_px": self.medians_px,
            "paper.weights": np.round(self.weights, 6).tolist(),
        }


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
