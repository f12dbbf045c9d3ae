"""The searches behind `calibrate sphere`: what is tried, how far it is, and what is kept.

Of the parameters of `focus` a sphere determines the neighbourhood and the least confidence. The
sphere's place is found by `focus` itself, so a depth that is off by the same
amount everywhere can't be seen: unless the height of the sphere's top is known, each choice is
judged by its errors about their median.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

import numpy as np

from roller_core.camera import Camera
from roller_core.progress import progress_bar
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods import focus
from roller_emvs.stopwatch import Stopwatch

from .contact import ContactWindow
from .error_table import I64, ErrorSummary, ErrorTable
from .grids import Grid, focus_grid, paper_grid, simplex
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
    overlap = max(settings.window_overlap, _FOCUS_OVERLAP)
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


class GridSearch:
    """Errors of all choices of a grid over windows.

    Parameters
    ----------
    grid : Grid
        Choices, of the settings' method.
    settings : DepthSettings
        Everything that the grid doesn't hold.
    windows : sequence of ContactWindow
        Events, poses and the truth.
    camera : Camera
        Intrinsics.
    absolute : bool
        See `focus_errors`.

    Attributes
    ----------
    table : ErrorTable
        Filled by `run`.
    notes : tuple of str
        What is to be said of the result.
    """

    def __init__(
        self,
        grid: Grid,
        settings: DepthSettings,
        windows: Sequence[ContactWindow],
        camera: Camera,
        absolute: bool = True,
    ) -> None:
        self.grid = grid
        self._settings, self._windows, self._camera = settings, windows, camera
        self._absolute = absolute
        self.notes: tuple[str, ...] = ()
        if not absolute:
            self.notes = (
                "errors count about their median, as the sphere's depth is focus's own; "
                "--top-height-mm makes them absolute",
            )

    def before(self) -> ErrorSummary:
        """Error and coverage of the settings as they are."""
        return self._filled(self.grid.of_settings(self._settings)).summary()

    def run(self) -> None:
        """Try all choices."""
        self.table = self._filled(self.grid)

    def _filled(self, grid: Grid) -> ErrorTable:
        table = ErrorTable.empty([w.view.pixels for w in self._windows], grid.size)
        with progress_bar("search") as progress:
            if self._settings.method == "focus":
                self._try_choices(grid, table, progress)
            else:
                self._try_windows(grid, table, progress)
        return table

    def _try_choices(
        self, grid: Grid, table: ErrorTable, progress: Callable[[float], None]
    ) -> None:
        for k in range(grid.size):
            settings = self._settings.changed(grid.values(k))
            table.errors_m[:, k], table.points[:, k] = focus_errors(
                self._windows, self._camera, settings, self._absolute
            )
            progress((k + 1) / grid.size)

    def _try_windows(
        self, grid: Grid, table: ErrorTable, progress: Callable[[float], None]
    ) -> None:
        for k, window in enumerate(self._windows):

            def report(share: float, done: int = k) -> None:
                progress((done + share) / len(self._windows))

            table.errors_m[k], table.points[k] = window_errors(
                window, self._camera, self._settings, grid, report
            )


def make_search(
    args: argparse.Namespace,
    settings: DepthSettings,
    windows: Sequence[ContactWindow],
    camera: Camera,
) -> GridSearch:
    """The search of the command's method."""
    if args.method == "focus":
        absolute = args.top_height_mm is not None
        return GridSearch(focus_grid(), settings, windows, camera, absolute)
    weights = simplex(len(settings.paper.weights), args.weight_parts)
    return GridSearch(paper_grid(weights), settings, windows, camera)
