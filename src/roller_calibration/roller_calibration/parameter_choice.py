"""Which parameters a grid search leads to: the best of the grid, or those that were there."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from roller_core.calibration_file import CalibrationError
from roller_emvs.depth_settings import DepthSettings

from .error_table import ErrorSummary
from .grid_search import GridSearch

#: The share by which the error must fall for parameters to be changed.
LEAST_GAIN = 0.005


@dataclass(frozen=True)
class ParameterChoice:
    """Parameters before and after a search, and their errors."""

    #: Share of the contact circle that had to be measured.
    least_coverage: float
    #: As they were, and their error.
    old: dict[str, Any]
    before: ErrorSummary
    #: As they are to be, and their error.
    values: dict[str, Any]
    after: ErrorSummary
    #: Whether nothing is enough better for them to be changed.
    stays: bool
    #: Parameters at the end of their range.
    border: list[str]
    #: Error on windows that had no say; None where that can't be told.
    held_out: ErrorSummary | None
    #: How long the search took.
    search_s: float


def choose_parameters(
    search: GridSearch,
    settings: DepthSettings,
    least_coverage: float | None,
    groups: Sequence[str],
) -> ParameterChoice:
    """Search the grid and choose.

    Parameters
    ----------
    search : GridSearch
        Not yet run.
    settings : DepthSettings
        The start.
    least_coverage : float or None
        Share of the contact circle that must be measured; None: as much as before.
    groups : sequence of str
        Of each window; see `ErrorTable.held_out`.

    Raises
    ------
    CalibrationError
        If nothing was measured before, so that it doesn't say how much must be.
    CoverageError
        See `ErrorTable.best`.
    """
    before = search.before()
    if least_coverage is None and not before.coverage:
        raise CalibrationError(
            "too few events: with the parameters as they are no pixel of the contact circle is "
            "measured; say with --least-coverage how many must be"
        )
    least = before.coverage if least_coverage is None else least_coverage
    begin_s = time.perf_counter()
    search.run()
    search_s = time.perf_counter() - begin_s
    best = search.table.best(least)
    values, after = search.grid.values(best), search.table.summary(best)
    old, border = search.grid.of_settings(settings).values(0), search.grid.at_border(best)
    stays = before.coverage >= least and after.error_m > (1 - LEAST_GAIN) * before.error_m
    if stays:
        values, after, border = old, before, []
    held_out = search.table.held_out(groups, least)
    return ParameterChoice(least, old, before, values, after, stays, border, held_out, search_s)
