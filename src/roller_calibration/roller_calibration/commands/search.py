"""The searches behind `calibrate sphere`: what is tried, how far it is, and what is kept."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from roller_calibration import (
    ContactWindow,
    ErrorTable,
    Figures,
    FocusGrid,
    PaperGrid,
    focus_errors,
    window_errors,
)
from roller_calibration.calibration_state import SearchState
from roller_core.camera import Camera
from roller_core.progress import progress_bar
from roller_emvs.depth_settings import DepthSettings

#: Parameters that a calibration of each method finds.
NAMES = {
    "bma": ("paper.threshold_c", "paper.median_px", "paper.weights"),
    "focus": ("focus.sigma_px", "focus.min_confidence", "focus.edge_drift_m"),
}
#: Windows of focus are long and few: they overlap by this share.
_FOCUS_OVERLAP = 0.75


def window_settings(settings: DepthSettings) -> DepthSettings:
    """Settings by which windows are cut for a calibration."""
    if settings.method != "focus":
        return settings
    overlap = max(settings.window.overlap, _FOCUS_OVERLAP)
    return settings.changed({"window.overlap": overlap})


class PaperSearch:
    """All choices of the paper's parameters, a window at a time."""

    def __init__(
        self,
        settings: DepthSettings,
        windows: Sequence[ContactWindow],
        camera: Camera,
        weight_parts: int,
    ) -> None:
        self.grid = PaperGrid.of_paper(len(settings.paper.weights), weight_parts)
        self._settings, self._windows, self._camera = settings, windows, camera
        self.table = ErrorTable.empty([w.view.pixels for w in windows], self.grid.size)
        self._state: SearchState | None = None

    def before(self) -> Figures:
        """Error and coverage of the settings as they are."""
        s = self._settings
        own = PaperGrid((s.paper.threshold_c,), (s.paper.median_px,), np.array([s.paper.weights]))
        table = ErrorTable.empty(self.table.pixels.tolist(), 1)
        for k, window in enumerate(self._windows):
            table.errors_m[k], table.points[k] = window_errors(window, self._camera, s, own)
        return table.figures()

    def grid_key(self) -> list[Any]:
        """What tells one grid from another."""
        return [*self.grid.thresholds, *self.grid.medians_px, list(self.grid.weights.shape)]

    def run(self, output: Path | None, key: dict[str, Any], resume: bool) -> bool:
        """Try what isn't known yet; whether anything was."""
        self._state = SearchState(output, key)
        resumed = resume and self._state.load(self.table)
        with progress_bar("search") as progress:
            for k, window in enumerate(self._windows):

                def tell(share: float, done: int = k) -> None:
                    progress((done + share) / len(self._windows))

                if np.isnan(self.table.errors_m[k]).any():
                    errors, points = window_errors(
                        window, self._camera, self._settings, self.grid, tell
                    )
                    self.table.points[k], self.table.errors_m[k] = points, errors
                    self._state.save(self.table)
        return resumed

    def notes(self) -> list[str]:
        """What is to be said of the result."""
        return []

    def forget(self) -> None:
        """The state is no longer needed."""
        if self._state is not None:
            self._state.forget()


class FocusSearch:
    """All choices of the parameters of focus, a choice at a time."""

    def __init__(
        self,
        settings: DepthSettings,
        windows: Sequence[ContactWindow],
        camera: Camera,
        absolute: bool,
    ) -> None:
        self.grid = FocusGrid()
        self._settings, self._windows, self._camera = settings, windows, camera
        self._absolute = absolute
        self.table = ErrorTable.empty([w.view.pixels for w in windows], self.grid.size)
        self._state: SearchState | None = None

    def before(self) -> Figures:
        """Error and coverage of the settings as they are."""
        table = ErrorTable.empty(self.table.pixels.tolist(), 1)
        self._fill(table, 0, self._settings)
        return table.figures()

    def grid_key(self) -> list[Any]:
        """What tells one grid from another."""
        return [*self.grid.sigmas_px, *self.grid.confidences, *self.grid.edge_drifts_m]

    def run(self, output: Path | None, key: dict[str, Any], resume: bool) -> bool:
        """Try what isn't known yet; whether anything was."""
        self._state = SearchState(output, key)
        resumed = resume and self._state.load(self.table)
        with progress_bar("search") as progress:
            for choice in range(self.grid.size):
                if np.isnan(self.table.errors_m[:, choice]).any():
                    changed = self._settings.changed(self.grid.values(choice))
                    self._fill(self.table, choice, changed)
                    self._state.save(self.table)
                progress((choice + 1) / self.grid.size)
        return resumed

    def notes(self) -> list[str]:
        """What is to be said of the result."""
        if self._absolute:
            return []
        return [
            "errors count about their median, as the sphere's depth is focus's own; "
            "--top-height-mm makes them absolute"
        ]

    def forget(self) -> None:
        """The state is no longer needed."""
        if self._state is not None:
            self._state.forget()

    def _fill(self, table: ErrorTable, column: int, settings: DepthSettings) -> None:
        errors, points = focus_errors(self._windows, self._camera, settings, self._absolute)
        table.points[:, column], table.errors_m[:, column] = points, errors


Search = PaperSearch | FocusSearch


def make_search(
    args: argparse.Namespace,
    settings: DepthSettings,
    windows: Sequence[ContactWindow],
    camera: Camera,
) -> Search:
    """The search of the command's method."""
    if args.method == "focus":
        return FocusSearch(settings, windows, camera, args.top_height_mm is not None)
    return PaperSearch(settings, windows, camera, args.weight_parts)
