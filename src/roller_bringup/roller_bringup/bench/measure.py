"""Times and errors of one configuration."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from roller_bringup.results import truth as results_truth
from roller_bringup.results.truth import TruthTally
from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.settings import DepthSettings
from roller_emvs.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.windows import RefusedWindow

from .cases import Case
from .resampling import Piece
from .scans import Scan

# TODO(merge): import SurfaceTally beside TruthTally, and drop `can_measure`.
_SURFACE_TALLY: Any = getattr(results_truth, "SurfaceTally", None)

#: Error figures of an object, in the order they are shown.
ERRORS = (
    "near_edge_mae_um",
    "mae_um",
    "median_um",
    "bias_um",
    "within_100_um",
    "edges_measured",
    "points",
)


def can_measure(method: str) -> bool:
    """Whether a method's results can be compared with the truth."""
    return method != "surface" or _SURFACE_TALLY is not None


def measure(case: Case, scans: Sequence[Scan], repeats: int, budget_s: float) -> dict[str, Any]:
    """Run a configuration over scans: once for the errors, several times for the times.

    Parameters
    ----------
    case : Case
        The configuration.
    scans : sequence of Scan
        At the case's speed, one an object.
    repeats : int
        Runs at most.
    budget_s : float
        No more runs after this time.

    Returns
    -------
    dict
        `time` (see `time_figures`), `error` (mean over the objects), `objects` (each one's).
    """
    settings = case.settings
    _warm_up(settings, scans[0])
    begin = time.perf_counter()
    runs: list[list[float]] = []
    objects: dict[str, Any] = {}
    counts = {"events": 0, "refused": 0}
    spent_on_truth = 0.0
    while len(runs) < max(repeats, 1):
        spent = time.perf_counter() - begin - spent_on_truth
        if runs and spent > budget_s:
            break
        first, run = not runs, []
        for scan in scans:
            tally = _tally(settings, scan) if first else None
            for found in _results(settings, scan):
                if isinstance(found, RefusedWindow):
                    counts["refused"] += first
                    continue
                run.append(found.milliseconds["total"])
                counts["events"] += found.events if first else 0
                if tally is not None:
                    before = time.perf_counter()
                    tally.add(found)
                    spent_on_truth += time.perf_counter() - before
            if tally is not None:
                objects[scan.name] = of_object(tally.summary(), scan.name)
        runs.append(run)
    total_s = sum(runs[0]) * 1e-3
    times = time_figures(runs)
    times["mev_s"] = round(counts["events"] * 1e-6 / total_s, 3) if total_s else None
    times["refused"] = counts["refused"]
    return {"time": times, "error": mean_error(objects.values()), "objects": objects}


def time_figures(runs: Sequence[Sequence[float]]) -> dict[str, Any]:
    """Median of the runs' medians, their extremes, and the 95th percentile of all windows, ms."""
    medians = [float(np.median(run)) for run in runs if len(run)]
    if not medians:
        return {"ms": None, "windows": 0, "repeats": len(runs)}
    return {
        "ms": round(float(np.median(medians)), 3),
        "ms_low": round(min(medians), 3),
        "ms_high": round(max(medians), 3),
        "ms_p95": round(float(np.percentile(np.concatenate(runs), 95)), 3),
        "windows": len(runs[0]),
        "repeats": len(runs),
    }


def mean_error(objects: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Mean over objects of their figures; each counts the same, however many points it has."""
    found = [figures for figures in objects if figures["points"]]
    out: dict[str, Any] = {"objects": len(found)}
    for name in ERRORS:
        values = [f[name] for f in found if f.get(name) is not None and np.isfinite(f[name])]
        if name == "points":
            out[name] = int(sum(values))
        else:
            out[name] = round(float(np.mean(values)), 4) if values else None
    return out


def depth_maps(settings: DepthSettings, pieces: Sequence[Piece]) -> list[DepthMap]:
    """Depth maps of windows that follow each other, by one pipeline.

    Parameters
    ----------
    settings : DepthSettings
        With windows by time that are as long as the pieces, or with one for all.
    pieces : sequence of Piece
        Of one scan.
    """
    scan = pieces[0].scan
    pipeline = DepthPipeline(settings, scan.camera, scan.track)
    for piece in pieces:
        pipeline.add_events(piece.events)
    found = pipeline.results(flush=True)
    return [result for result in found if isinstance(result, DepthMap)]


def window_times(
    settings: DepthSettings, windows: Sequence[tuple[EventArray, Scan]], repeats: int
) -> dict[str, Any]:
    """Times of windows that have nothing to do with each other; the first run is not counted.

    Parameters
    ----------
    settings : DepthSettings
        With one window for all events.
    windows : sequence of (EventArray, Scan)
        Events of each window, with the scan whose camera and poses they belong to.
    repeats : int
        Runs that count.
    """
    runs: list[list[float]] = []
    for _ in range(repeats + 1):
        run = []
        for events, scan in windows:
            pipeline = DepthPipeline(settings, scan.camera, scan.track)
            pipeline.add_events(events)
            for found in pipeline.results(flush=True):
                if isinstance(found, DepthMap):
                    run.append(found.milliseconds["total"])
        runs.append(run)
    return time_figures(runs[1:])


def _results(settings: DepthSettings | SurfaceSettings, scan: Scan) -> Iterable[Any]:
    if isinstance(settings, SurfaceSettings):
        # Rows of the surface are measured over their whole crossing of the image.
        sweep = SurfaceSweep(settings, scan.camera, scan.track)
        sweep.add_events(scan.events)
        return sweep.results(flush=True)
    pipeline = DepthPipeline(settings, scan.camera, scan.track)
    pipeline.add_events(scan.crossing())
    return pipeline.results(flush=True)


def _warm_up(settings: DepthSettings | SurfaceSettings, scan: Scan) -> None:
    """Compile what the case needs: the first window isn't timed."""
    next(iter(_results(settings, scan)), None)


def _tally(settings: DepthSettings | SurfaceSettings, scan: Scan) -> Any:
    return (
        _SURFACE_TALLY(scan.truth)
        if isinstance(settings, SurfaceSettings)
        else TruthTally(scan.truth)
    )


def of_object(summary: dict[str, Any], name: str) -> dict[str, Any]:
    """One object's figures in a tally's summary; all there is for a plate without objects."""
    figures = dict(summary["objects"].get(name, summary["all"]))
    # TODO(merge): every tally gives the error near edges then.
    figures.setdefault("near_edge_mae_um", figures.get("mae_um"))
    return {key: figures.get(key) for key in ERRORS}
