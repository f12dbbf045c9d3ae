"""The searches behind `calibrate sphere`: what is tried, how far it is, and what is kept.

Of the parameters of `focus` a sphere determines the neighbourhood and the least confidence. The
sphere's place is found by `focus` itself, so a depth that is off by the same
amount everywhere can't be seen: unless the height of the sphere's top is known, each choice is
judged by its errors about their median.
"""

from __future__ import annotations

import argparse
import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from roller_core.camera import Camera
from roller_core.progress import progress_bar
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods import focus
from roller_emvs.stopwatch import Stopwatch

from .contact import ContactWindow
from .error_table import I64, ErrorSummary, ErrorTable
from .grids import FocusGrid, PaperGrid
from .paper_search import window_errors

#: Parameters that a calibration of each method finds.
NAMES = {
    "bma": ("paper.threshold_c", "paper.median_px", "paper.weights"),
    "focus": ("focus.sigma_px", "focus.min_confidence"),
}
#: Windows of focus are long and few: they overlap by this share.
_FOCUS_OVERLAP = 0.75


def window_settings(settings: DepthSettings) -> DepthSettings:
    """Settings by which windows are cut for a calibration."""
    if settings.method != "focus":
        return settings
    overlap = max(settings.window.overlap, _FOCUS_OVERLAP)
    return settings.changed({"window.overlap": overlap})


def focus_errors(
    windows: Sequence[ContactWindow], camera: Camera, settings: DepthSettings, absolute: bool
) -> tuple[F64, I64]:
    """Errors of one choice for `focus` over the contact circle of every window.

    Parameters
    ----------
    windows : sequence of ContactWindow
        Events, poses and the truth.
    camera : Camera
        Intrinsics.
    settings : DepthSettings
        Of the choice.
    absolute : bool
        Whether the truth's depth is known of its own; else errors count about their median.

    Returns
    -------
    errors_m : ndarray of float64, shape (windows,)
        Sums of absolute errors, metres.
    points : ndarray of int64, shape (windows,)
        Measured pixels.
    """
    found = []
    for window in windows:
        prepared, view = window.prepared, window.view
        depth, *_ = focus.focus_depth(
            prepared.packets, camera, prepared.target, settings, Stopwatch()
        )
        miss = (view.box.of(depth) - view.depth_m)[view.mask]
        found.append(miss[np.isfinite(miss)])
    every = np.concatenate(found)
    offset = 0.0 if absolute or not len(every) else float(np.median(every))
    errors = np.array([np.abs(miss - offset).sum() for miss in found])
    return errors, np.array([len(miss) for miss in found], np.int64)


class GridSearch(ABC):
    """Errors of all choices of a grid over windows.

    Parameters
    ----------
    grid : Grid
        Choices.
    settings : DepthSettings
        Everything that the grid doesn't hold.
    windows : sequence of ContactWindow
        Events, poses and the truth.
    camera : Camera
        Intrinsics.

    Attributes
    ----------
    table : ErrorTable
        Filled by `run`.
    """

    #: What is to be said of the result.
    notes: tuple[str, ...] = ()

    def __init__(
        self, grid: Any, settings: DepthSettings, windows: Sequence[ContactWindow], camera: Camera
    ) -> None:
        self.grid = grid
        self._settings, self._windows, self._camera = settings, windows, camera
        self.table = ErrorTable.empty([w.view.pixels for w in windows], grid.size)

    def before(self) -> ErrorSummary:
        """Error and coverage of the settings as they are."""
        own = copy.copy(self)
        own.grid = self.grid.of_settings(self._settings)
        own.table = ErrorTable.empty(self.table.pixels.tolist(), 1)
        own.run()
        return own.table.summary()

    def run(self) -> None:
        """Try all choices."""
        with progress_bar("search") as progress:
            self._fill(progress)

    @abstractmethod
    def _fill(self, progress: Callable[[float], None]) -> None:
        """Fill the table; reports the share done."""


class PaperSearch(GridSearch):
    """All choices of the paper's parameters, a window at a time."""

    def _fill(self, progress: Callable[[float], None]) -> None:
        for k, window in enumerate(self._windows):

            def report(share: float, done: int = k) -> None:
                progress((done + share) / len(self._windows))

            self.table.errors_m[k], self.table.points[k] = window_errors(
                window, self._camera, self._settings, self.grid, report
            )


class FocusSearch(GridSearch):
    """All choices of the parameters of `focus`, a choice at a time."""

    #: Whether the truth's depth is known of its own.
    absolute = True

    def _fill(self, progress: Callable[[float], None]) -> None:
        for k in range(self.grid.size):
            settings = self._settings.changed(self.grid.values(k))
            self.table.errors_m[:, k], self.table.points[:, k] = focus_errors(
                self._windows, self._camera, settings, self.absolute
            )
            progress((k + 1) / self.grid.size)


def make_search(
    args: argparse.Namespace,
    settings: DepthSettings,
    windows: Sequence[ContactWindow],
    camera: Camera,
) -> GridSearch:
    """The search of the command's method."""
    if args.method == "focus":
        search = FocusSearch(FocusGrid(), settings, windows, camera)
        if args.top_height_mm is None:
            search.absolute = False
            search.notes = (
                "errors count about their median, as the sphere's depth is focus's own; "
                "--top-height-mm makes them absolute",
            )
        return search
    grid = PaperGrid.of_paper(len(settings.paper.weights), args.weight_parts)
    return PaperSearch(grid, settings, windows, camera)
