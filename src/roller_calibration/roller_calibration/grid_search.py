"""The searches behind `calibrate sphere`: what is tried, how far it is, and what is kept.

Of the parameters of `focus` a sphere determines the neighbourhood and the least confidence. The
sphere's place is found by `focus` itself, so a depth that is off by the same
amount everywhere can't be seen: unless the height of the sphere's top is known, each choice is
judged by its errors about their median.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.calibration_file import CalibrationError
from roller_core.camera import Camera
from roller_core.errors import UnwritableOutputError
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
#: What a state holds beside its key.
_KEPT = ("errors_m", "points", "pixels")
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
    """Errors of all choices of a grid over windows, part by part.

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
        own._fill(lambda: None)
        return own.table.summary()

    def run(self, output: Path | None, key: Mapping[str, Any], resume: bool) -> bool:
        """Fill the table; whether some of it was known.

        Parameters
        ----------
        output : path or None
            File that the calibration writes; what is known is kept beside it.
        key : mapping
            All that the errors depend on but the grid, JSON.
        resume : bool
            Whether to take what an interrupted search of the same key has kept.

        Raises
        ------
        CalibrationError
            If what was kept isn't of the same recordings, settings and grid, or is spoilt.
        UnwritableOutputError
            If the state can't be written.
        """
        if output is None:
            self._fill(lambda: None)
            return False
        # As JSON gives it back: without tuples.
        whole = json.loads(json.dumps({**key, "grid": self.grid.ranges}))
        path = state_path(output)
        # Also where it isn't asked for: what lies there is replaced, so it must be ours.
        kept = _read(path) if path.exists() else None
        resumed = resume and kept is not None
        if resume and kept is not None:
            _take(path, kept, whole, self.table)
        self._fill(lambda: _save(path, whole, self.table))
        return resumed

    def _fill(self, save: Callable[[], None]) -> None:
        """Try what isn't known yet, and save after each part."""
        table = self.table
        with progress_bar("search") as progress:
            for k in range(self._parts):

                def report(share: float, done: int = k) -> None:
                    progress((done + share) / self._parts)

                where = self._where(k)
                if np.isnan(table.errors_m[where]).any():
                    table.errors_m[where], table.points[where] = self._errors(k, report)
                    save()
                report(1.0)

    @property
    @abstractmethod
    def _parts(self) -> int:
        """Parts of the table that are tried at a time."""

    @abstractmethod
    def _where(self, part: int) -> Any:
        """Index of a part in the table."""

    @abstractmethod
    def _errors(self, part: int, report: Callable[[float], None]) -> tuple[F64, I64]:
        """Errors and points of a part; reports the share done."""


class PaperSearch(GridSearch):
    """All choices of the paper's parameters, a window at a time."""

    @property
    def _parts(self) -> int:
        return len(self._windows)

    def _where(self, part: int) -> Any:
        return part

    def _errors(self, part: int, report: Callable[[float], None]) -> tuple[F64, I64]:
        return window_errors(self._windows[part], self._camera, self._settings, self.grid, report)


class FocusSearch(GridSearch):
    """All choices of the parameters of `focus`, a choice at a time."""

    #: Whether the truth's depth is known of its own.
    absolute = True

    @property
    def _parts(self) -> int:
        return int(self.grid.size)

    def _where(self, part: int) -> Any:
        return slice(None), part

    def _errors(self, part: int, report: Callable[[float], None]) -> tuple[F64, I64]:
        settings = self._settings.changed(self.grid.values(part))
        return focus_errors(self._windows, self._camera, settings, self.absolute)


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


def state_path(output: Path) -> Path:
    """Where a search keeps what it has done, until its calibration is written to `output`."""
    return output.with_name(output.name + ".state.npz")


def _read(path: Path) -> dict[str, Any]:
    """What an interrupted search has kept."""
    try:
        with np.load(path, allow_pickle=False) as state:
            return {"key": json.loads(str(state["key"])), **{name: state[name] for name in _KEPT}}
    except Exception as error:  # numpy's and zipfile's own, of a file that is something else
        raise CalibrationError(
            f"{path}: not the state of a calibration ({error}); move it, or name another --output"
        ) from error


def _take(path: Path, kept: Mapping[str, Any], key: Mapping[str, Any], table: ErrorTable) -> None:
    """Fill a table with what was kept."""
    other = [name for name in key if kept["key"].get(name) != key[name]]
    errors, points, pixels = (kept[name] for name in _KEPT)
    if other or errors.shape != table.errors_m.shape or not np.array_equal(pixels, table.pixels):
        raise CalibrationError(
            f"{path}: the state is of other {', '.join(other) or 'windows'}; give the same, or "
            "leave out --resume to start again"
        )
    table.errors_m[:], table.points[:] = errors, points


def _save(path: Path, key: Mapping[str, Any], table: ErrorTable) -> None:
    """Keep a table."""
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as stream:
            np.savez(
                stream, key=json.dumps(key), errors_m=table.errors_m, points=table.points,
                pixels=table.pixels,
            )  # fmt: skip
        os.replace(part, path)
    except OSError as error:
        raise UnwritableOutputError(f"{path}: can't be written ({error.strerror})") from error
