"""Times and errors of one configuration."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.windows import RefusedWindow
from roller_inspect.results.truth_tally import SurfaceTally, TruthTally

from .cases import Case
from .resampling import Piece
from .scans import CROSSING_M, Scan

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


class CaseRun:
    """One configuration over scans, run again and again.

    Parameters
    ----------
    case : Case
        The configuration.
    scans : sequence of Scan
        At the case's speed, one an object.
    """

    def __init__(self, case: Case, scans: Sequence[Scan]) -> None:
        self.case = case
        self.spent_s = 0.0
        self._scans = scans
        self._runs: list[list[float]] = []
        self._whole_ms: list[float] = []
        self._objects: dict[str, Any] = {}
        self._events = self._refused = 0

    def go(self) -> None:
        """Run once over all scans; the first time errors are taken too."""
        settings, run, whole_ms = self.case.settings, [], 0.0
        first = not self._runs
        if first:
            _warm_up(settings, self._scans[0])
        for scan in self._scans:
            tally = tally_for(settings, scan) if first else None
            events = events_for(settings, scan)
            for found, spent in _timed(results_of(settings, scan, events)):
                whole_ms += spent
                if isinstance(found, RefusedWindow):
                    self._refused += first
                    self._events -= first * found.events
                    continue
                if not isinstance(found, SurfacePatch) or _over_object(found, scan):
                    run.append(spent)
                if tally is not None:
                    tally.add(found)
            if tally is not None:
                self._events += len(events)
                self._objects[scan.name] = of_object(tally.summary(), scan.name)
        self._runs.append(run)
        self._whole_ms.append(whole_ms)
        self.spent_s += whole_ms * 1e-3

    @property
    def medians(self) -> list[float]:
        """Median ms a window of each run."""
        return [float(np.median(run)) for run in self._runs if run]

    def figures(self) -> dict[str, Any]:
        """`time` (see `time_figures`), `error` (mean over the objects), `objects` (each one's)."""
        times = time_figures(self._runs)
        each = np.array(self._whole_ms) / (self._events * 1e-6)
        times["ms_per_mev"] = round(float(np.median(each)), 3)
        times["ms_per_mev_low"] = round(float(each.min()), 3)
        times["ms_per_mev_high"] = round(float(each.max()), 3)
        times["refused"] = self._refused
        error = mean_error(self._objects.values())
        return {"time": times, "error": error, "objects": self._objects}


def run_rounds(
    runs: Sequence[CaseRun], repeats: int, budget_s: float, tell: Callable[[CaseRun], None]
) -> None:
    """Run all cases once, then all of them again, and so on.

    What else the machine does meanwhile falls on all cases alike, and shows as their spread.

    Parameters
    ----------
    runs : sequence of CaseRun
        The cases.
    repeats : int
        Rounds.
    budget_s : float
        A case that has taken longer stays out of further rounds.
    tell : callable
        Told the case at hand.
    """
    for number in range(max(repeats, 1)):
        for run in runs:
            if number == 0 or run.spent_s <= budget_s:
                tell(run)
                run.go()


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
        values = [f[name] for f in found if f.get(name) is not None]
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


def window_ms(settings: DepthSettings, events: EventArray, scan: Scan) -> float | None:
    """Time for one window; None where it gives no depth.

    Parameters
    ----------
    settings : DepthSettings
        With one window for all events.
    events : EventArray
        Of the window.
    scan : Scan
        Whose camera and poses they belong to.
    """
    pipeline = DepthPipeline(settings, scan.camera, scan.track)
    pipeline.add_events(events)
    for found in pipeline.results(flush=True):
        if isinstance(found, DepthMap):
            return found.milliseconds["total"]
    return None


def events_for(settings: DepthSettings | SurfaceSettings, scan: Scan) -> EventArray:
    """Events of a scan that a method is measured on."""
    # Rows of the surface are measured over their whole crossing of the image.
    return scan.events if isinstance(settings, SurfaceSettings) else scan.crossing()


def results_of(
    settings: DepthSettings | SurfaceSettings, scan: Scan, events: EventArray
) -> Iterator[Any]:
    """All that a method makes of events of a scan."""
    engine: SurfaceSweep | DepthPipeline
    if isinstance(settings, SurfaceSettings):
        engine = SurfaceSweep(settings, scan.camera, scan.track)
    else:
        engine = DepthPipeline(settings, scan.camera, scan.track)
    engine.add_events(events)
    return iter(engine.results(flush=True))


def _timed(results: Iterator[Any]) -> Iterator[tuple[Any, float]]:
    """Results and the ms that each took, from events that wait; so cutting them counts too."""
    while True:
        begin = time.perf_counter()
        found = next(results, None)
        spent = (time.perf_counter() - begin) * 1e3
        if found is None:
            return
        yield found, spent


def _over_object(found: SurfacePatch, scan: Scan) -> bool:
    """Whether a block lies where depth maps are made too, not on the bare plate around it."""
    region = scan.truth.objects.get(scan.name)
    if region is None or not len(found):
        return region is None
    middle = 0.5 * (region.x0 + region.x1)
    return bool(abs(np.median(found.points[:, 0]) - middle) <= 0.5 * CROSSING_M)


def _warm_up(settings: DepthSettings | SurfaceSettings, scan: Scan) -> None:
    """Compile what the case needs: the first window that gives depth isn't timed."""
    for found in results_of(settings, scan, events_for(settings, scan)):
        if not isinstance(found, RefusedWindow):
            return


def tally_for(settings: DepthSettings | SurfaceSettings, scan: Scan) -> Any:
    """What collects a method's errors on a scan."""
    surface = isinstance(settings, SurfaceSettings)
    return SurfaceTally(scan.truth) if surface else TruthTally(scan.truth)


def of_object(summary: dict[str, Any], name: str) -> dict[str, Any]:
    """One object's figures in a tally's summary; all there is for a plate without objects."""
    figures = dict(summary["objects"].get(name, summary["all"]))
    # An object without relief edges has no share of them.
    return {k: v if (v := figures.get(k)) is None or np.isfinite(v) else None for k in ERRORS}
