"""Errors of all weights of the three views: the paper's cross-validation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from roller_calibration.contact import Box, KnownWindow, TrueDepth
from roller_calibration.grids import PaperGrid, simplex
from roller_calibration.paper_search import window_errors
from roller_core.errors import RollerError
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.windows import RefusedWindow
from roller_evaluation.bench.scans import Scan

#: Weights are whole multiples of its inverse; 18 hold the paper's 8, 6 and 4.
PARTS = 18
#: Weights must measure this share of what the most would: leaving out views is no merit.
_LEAST_POINTS = 0.95


def weight_choices() -> F64:
    """All weights that are tried, shape (n, 3)."""
    return simplex(3, PARTS)


@dataclass(frozen=True)
class BestWeights:
    """The best weights of an object, tried on all objects.

    Attributes
    ----------
    name : str
        The object that they are the best of.
    weights : tuple of float
        Of start, middle and end.
    error_um : tuple of float
        Mean absolute error of each object with them.
    measured : tuple of float
        Share of each object's pixels in contact that have a depth.
    """

    name: str
    weights: tuple[float, ...]
    error_um: tuple[float, ...]
    measured: tuple[float, ...]


def weight_errors(scan: Scan, settings: DepthSettings) -> dict[str, Any]:
    """Errors of each of `weight_choices` over an object.

    `mae_um` is the mean absolute error, `points` the measured pixels, of `pixels` in contact.

    Parameters
    ----------
    scan : Scan
        A pass over the object.
    settings : DepthSettings
        Method `bma`.
    """
    grid = PaperGrid((settings.paper.threshold_c,), (settings.paper.median_px,), weight_choices())
    errors, points, pixels = np.zeros(grid.size), np.zeros(grid.size, np.int64), 0
    for window in _windows(scan, settings):
        found, count = window_errors(window, scan.camera, settings, grid)
        errors += found
        points += count
        pixels += window.view.pixels
    each = np.divide(errors, points, out=np.full(len(errors), np.nan), where=points > 0)
    mae_um = [round(float(v) * 1e6, 3) for v in each]
    return {"mae_um": mae_um, "points": points.tolist(), "pixels": pixels}


def cross_validated(found: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[BestWeights]:
    """The best weights of each object, tried on all.

    As the paper does it: mean over an object's passes first, then over the objects.

    Parameters
    ----------
    found : mapping
        By object, `weight_errors` of its passes.
    """
    choices = weight_choices()
    error: dict[str, F64] = {}
    share: dict[str, F64] = {}
    usable = np.ones(len(choices), bool)
    for name, passes in found.items():
        error[name] = np.nanmean([p["mae_um"] for p in passes], axis=0)
        points = np.sum([p["points"] for p in passes], axis=0)
        share[name] = points / sum(p["pixels"] for p in passes)
        usable &= points >= _LEAST_POINTS * points.max()
    rows = []
    for name, own in error.items():
        best = int(np.nanargmin(np.where(usable, own, np.nan)))
        rows.append(
            BestWeights(
                name,
                tuple(choices[best].tolist()),
                tuple(float(e[best]) for e in error.values()),
                tuple(float(s[best]) for s in share.values()),
            )
        )
    return rows


def _windows(scan: Scan, settings: DepthSettings) -> Iterator[KnownWindow]:
    pipeline = DepthPipeline(settings, scan.camera, scan.track)
    pipeline.add_events(scan.crossing())
    for window in pipeline.windows(flush=True):
        if isinstance(window, RefusedWindow):
            continue
        try:
            prepared = pipeline.prepare(window)
        except RollerError:
            continue  # no parallax: no depth in a replay either
        view = _truth(scan, prepared.middle_ns - scan.truth.event_delay_ns)
        if view.pixels:
            yield KnownWindow(scan.name, prepared, view)


def _truth(scan: Scan, at_ns: int) -> TrueDepth:
    """True depth of the object where the skin is pressed on it."""
    camera = scan.camera
    depth = scan.truth.depth_image(at_ns).astype(np.float64)
    position = scan.truth.camera_positions(at_ns)[0]
    u, v = np.arange(camera.width)[None, :], np.arange(camera.height)[:, None]
    x = position[0] + (u - camera.cx) / camera.fx * depth
    y = position[1] - (v - camera.cy) / camera.fy * depth
    mask = scan.truth.contact_mask(at_ns) & scan.truth.objects[scan.name].contains(x, y)
    return TrueDepth(Box(0, 0, camera.width, camera.height), depth, mask)
