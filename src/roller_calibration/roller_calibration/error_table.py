"""Errors of many parameters over windows: which are best, and how well that holds elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.errors import RollerError
from roller_core.transforms import F64

I64 = npt.NDArray[np.int64]


class CoverageError(RollerError):
    """No parameters measure as much as is asked for."""


@dataclass(frozen=True)
class ErrorSummary:
    """An error with the coverage that it holds for."""

    #: Mean absolute error of the measured pixels within the contact circle, metres.
    error_m: float
    #: Share of the circle's pixels that are measured.
    coverage: float

    def __str__(self) -> str:
        return f"{self.error_m * 1e6:.1f} µm at {self.coverage:.1%} of the contact circle"


@dataclass
class ErrorTable:
    """Sums of errors by window and choice of parameters, filled bit by bit."""

    #: Sums of absolute errors, metres; NaN where not yet known. Shape (windows, choices).
    errors_m: F64
    #: Measured pixels within the contact circle. Shape (windows, choices).
    points: I64
    #: All pixels within it. Shape (windows,).
    pixels: I64

    @classmethod
    def empty(cls, pixels: Sequence[int], choices: int) -> ErrorTable:
        """A table of which nothing is known yet."""
        shape = (len(pixels), choices)
        return cls(np.full(shape, np.nan), np.zeros(shape, np.int64), np.asarray(pixels, np.int64))

    def summary(self, choice: int = 0, windows: Sequence[int] | None = None) -> ErrorSummary:
        """Error and coverage of a choice over all or some windows."""
        rows = slice(None) if windows is None else list(windows)
        points = int(self.points[rows, choice].sum())
        error = float(self.errors_m[rows, choice].sum()) / points if points else float("nan")
        return ErrorSummary(error, points / int(self.pixels[rows].sum()))

    def best(self, least_coverage: float, windows: Sequence[int] | None = None) -> int:
        """Choice of the least error among those that measure enough.

        Parameters
        ----------
        least_coverage : float
            Share of the contact circle that must be measured, so that leaving out points is no
            merit.
        windows : sequence of int, optional
            Windows that count; all by default.

        Raises
        ------
        CoverageError
            If none does.
        """
        rows = slice(None) if windows is None else list(windows)
        points = self.points[rows].sum(axis=0)
        coverage = points / self.pixels[rows].sum()
        with np.errstate(invalid="ignore", divide="ignore"):
            error = np.where(
                (coverage >= least_coverage) & (points > 0),
                self.errors_m[rows].sum(axis=0) / points,
                np.inf,
            )
        if not np.isfinite(error).any():
            raise CoverageError(
                f"no parameters of the grid measure {least_coverage:.1%} of the contact circle; "
                f"the most is {coverage.max():.1%}"
            )
        return int(np.argmin(error))

    def held_out(self, groups: Sequence[str], least_coverage: float) -> ErrorSummary | None:
        """Summary over each group with the parameters that the other groups choose.

        Parameters
        ----------
        groups : sequence of str
            Of each window; windows of a group stay together.
        least_coverage : float
            As for `best`.

        Returns
        -------
        ErrorSummary or None
            None where there is one group alone, or the others can't reach the coverage.
        """
        names = np.asarray(groups)
        error = points = pixels = 0.0
        for name in np.unique(names):
            own, others = np.flatnonzero(names == name), np.flatnonzero(names != name)
            if not len(others):
                return None
            try:
                choice = self.best(least_coverage, others.tolist())
            except CoverageError:
                return None
            error += float(self.errors_m[own, choice].sum())
            points += float(self.points[own, choice].sum())
            pixels += float(self.pixels[own].sum())
        return ErrorSummary(error / points, points / pixels) if points else None
