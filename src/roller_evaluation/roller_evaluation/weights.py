"""Errors of all weights of the three views: the paper's cross-validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from roller_calibration.contact import Box, KnownWindow, TrueDepth, prepared_windows
from roller_calibration.grids import paper_grid, simplex
from roller_calibration.paper_search import window_errors
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings

from .cases import Case
from .rows import Row
from .scans import Scan

#: Weights are whole multiples of its inverse; 18 hold the paper's 8, 6 and 4.
PARTS = 18
#: Weights must measure this share of what the most would: leaving out views is no merit.
_LEAST_POINTS = 0.95


def weight_choices() -> F64:
    """All weights that are tried, shape (n, 3)."""
    return simplex(3, PARTS)


def measure_weights(case: Case, scan: Scan) -> list[Row]:
    """Errors of each of `weight_choices` over an object, one row each.

    `mae_um` is the mean absolute error, `points` the measured pixels, of `pixels` in contact.
    """
    settings, choices = case.depth, weight_choices()
    assert isinstance(settings, DepthSettings)
    grid = paper_grid(choices, (settings.paper.threshold_c,), (settings.paper.median_px,))
    errors, points, pixels = np.zeros(grid.size), np.zeros(grid.size, np.int64), 0
    for window in _windows(scan, settings):
        found, count = window_errors(window, scan.camera, settings, grid)
        errors += found
        points += count
        pixels += window.view.pixels
    rows = []
    for k, (start, middle, end) in enumerate(choices.tolist()):
        mae_um = round(float(errors[k] / points[k]) * 1e6, 3) if points[k] else None
        row = {"object": scan.name, "choice": k, "start": start, "middle": middle, "end": end}
        rows.append(row | {"mae_um": mae_um, "points": int(points[k]), "pixels": pixels})
    return rows


def cross_validated(rows: Sequence[Row], names: Sequence[str]) -> list[tuple[str, F64, F64, F64]]:
    """The best weights of each object, tried on all.

    As the paper does it: mean over an object's passes first, then over the objects.

    Returns
    -------
    list of (str, ndarray, ndarray, ndarray)
        An object, the best weights of start, middle and end for it, the mean absolute error of
        each object with them, µm, and the share of each one's pixels in contact with a depth.
    """
    choices = weight_choices()
    error: dict[str, F64] = {}
    share: dict[str, F64] = {}
    usable = np.ones(len(choices), bool)
    for name in names:
        own = sorted((r for r in rows if r["object"] == name), key=lambda r: r["choice"])
        shape = len(choices), -1
        mae = np.array([r["mae_um"] for r in own], np.float64).reshape(shape)
        points = np.array([r["points"] for r in own]).reshape(shape).sum(axis=1)
        pixels = np.array([r["pixels"] for r in own]).reshape(shape).sum(axis=1)
        error[name], share[name] = np.nanmean(mae, axis=1), points / pixels
        usable &= points >= _LEAST_POINTS * points.max()
    best = {name: int(np.nanargmin(np.where(usable, e, np.nan))) for name, e in error.items()}
    errors, shares = np.array(list(error.values())), np.array(list(share.values()))
    return [(name, choices[k], errors[:, k], shares[:, k]) for name, k in best.items()]


def _windows(scan: Scan, settings: DepthSettings) -> Iterator[KnownWindow]:
    for prepared in prepared_windows(scan.camera, scan.track, scan.crossing, settings):
        view = _truth(scan, prepared.middle_ns - scan.truth.event_delay_ns)
        if view.pixels:
            yield KnownWindow(scan.name, prepared, view)


def _truth(scan: Scan, at_ns: int) -> TrueDepth:
    """True depth of the object where the skin is pressed on it."""
    camera = scan.camera
    seen, contact = scan.truth.seen_images(at_ns)
    depth = seen.astype(np.float64)
    x, y = scan.truth.places(at_ns, depth)
    mask = contact & scan.truth.objects[scan.name].contains(x, y)
    return TrueDepth(Box(0, 0, camera.width, camera.height), depth, mask)
