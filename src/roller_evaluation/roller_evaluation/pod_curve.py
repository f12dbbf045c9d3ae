"""Probability of detection by size, after MIL-HDBK-1823A: hits and misses, logit on ln a."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, minimize_scalar
from scipy.special import expit, gammaincinv, log_expit, logit

#: Probability of detection of the size that is reported, and the one-sided confidence in it.
POD, CONFIDENCE = 0.9, 0.95
#: Slopes of the curve in ln a that are tried: 0.9 is reached over a factor of e^±22 to ±0.02.
_SLOPES = (0.1, 100.0)
#: Sizes that are tried for a90, by the least and the largest target.
_AROUND = 20.0

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PodCurve:
    """A fitted curve."""

    #: Size that is found with a probability of 0.9; None beyond the largest target.
    a90: float | None
    #: The size for which that holds with a confidence of 95 %; None beyond the largest target.
    a90_95: float | None
    #: Of the logit in ln a.
    slope: float
    #: Size at which the fitted curve is at 0.9, wherever it is.
    middle: float
    #: How many.
    targets: int
    hits: int

    def at(self, sizes: npt.ArrayLike) -> F64:
        """Probability of detection by size."""
        away = np.log(np.asarray(sizes, np.float64) / self.middle)
        return np.asarray(expit(logit(POD) + self.slope * away), np.float64)


def fit_pod(sizes: Sequence[float], hits: Sequence[bool]) -> PodCurve:
    """Fit a curve by maximum likelihood; its bound is that of the profile likelihood of a90.

    The curve doesn't fall with size. What would be reached beyond the targets tried is not
    reported.

    Parameters
    ----------
    sizes : sequence of float
        Positive, in any unit.
    hits : sequence of bool
        Whether each was found.

    Raises
    ------
    ValueError
        Without targets.
    """
    if not len(sizes):
        raise ValueError("a curve needs targets")
    log_a, found = np.log(np.asarray(sizes, np.float64)), np.asarray(hits, bool)

    def best(log_a90: float) -> tuple[float, float]:
        """Largest log likelihood over the slope for a given a90, and the slope."""

        def misfit(log_slope: float) -> float:
            x = logit(POD) + np.exp(log_slope) * (log_a - log_a90)
            return -float(np.sum(log_expit(np.where(found, x, -x))))

        at = minimize_scalar(misfit, bounds=tuple(np.log(_SLOPES)), method="bounded")
        return -float(at.fun), float(np.exp(at.x))

    low, high = log_a.min() - np.log(_AROUND), log_a.max() + np.log(_AROUND)
    places = np.linspace(low, high, 81)
    profile = np.array([best(place)[0] for place in places])
    k = int(np.argmax(profile))
    near = places[max(k - 1, 0)], places[min(k + 1, len(places) - 1)]
    middle = float(minimize_scalar(lambda t: -best(t)[0], bounds=near, method="bounded").x)
    top, slope = best(middle)
    # One-sided: the two-sided interval of twice the risk. Half of chi²'s quantile, one degree.
    floor = top - gammaincinv(0.5, 2 * CONFIDENCE - 1)
    beyond = [place for place, value in zip(places, profile, strict=True)
              if place > middle and value < floor]  # fmt: skip
    bound = None
    if beyond:
        bound = float(brentq(lambda t: best(t)[0] - floor, middle, beyond[0]))
    largest = float(log_a.max()) + 1e-9
    return PodCurve(
        float(np.exp(middle)) if middle <= largest else None,
        float(np.exp(bound)) if bound is not None and bound <= largest else None,
        slope, float(np.exp(middle)), len(found), int(found.sum()),
    )  # fmt: skip


def poisson_bound(count: int, exposure: float) -> float:
    """Upper bound of a rate of which so many were counted over an exposure."""
    return float(gammaincinv(count + 1, CONFIDENCE)) / exposure if exposure > 0 else np.inf
