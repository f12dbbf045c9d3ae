"""What is measured on a scan: errors and times of depth, of stitched plates, of single windows."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.depth_stage import EmvsParameters
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.patch import Patch
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.surface_stage import SurfaceParameters
from roller_emvs.windows import RefusedWindow
from roller_inspect.pipeline import Pipeline, PipelineSettings
from roller_inspect.results.truth_tally import SurfaceTally, TruthTally
from roller_sim.relief import Region

from .braille_reading import measure_braille
from .cases import METHODS, Case
from .detection import measure_detection
from .figures import object_errors, time_columns
from .fixed_window import measure_fixed_window
from .map_errors import measure_map
from .plate_surface import measure_coverage
from .rows import Row
from .scaling import measure_window
from .scans import CROSSING_M, Scan
from .weights import measure_weights

#: Stages of depth and `surface`, in their order; what is in none of them is `other`.
STAGES = (
    "hot pixels", "packets", "rays", "arrange", "votes", "detection", "fusion", "points", "lines",
    "other",
)  # fmt: skip
#: Measures whose rows hold times.
TIMED = ("depth", "pass")
#: Columns of processor time by stage, ns an event.
STAGE_COLUMNS = {stage: f"cpu_ns_{stage.replace(' ', '_')}" for stage in STAGES}
#: Columns of `measure_depth` that differ from run to run.
TIMES = (
    "ms", "ms_mean", "ms_p95", "cpu_ms", "ms_per_mev", "cpu_ms_per_mev", "spent_ms",
    *STAGE_COLUMNS.values(),
)  # fmt: skip
#: Around what lies on a plate, what of it counts, m.
_AROUND_M = 0.001
#: What of a line's top counts, away from its walls, m.
_TOP_M = 0.0002
#: Cells in which tops are covered, m.
_TOP_CELL_M = 1e-4


def measure_depth(case: Case, scan: Scan) -> list[Row]:
    """Errors and times of a method's depth maps, or rows, while an object crosses the image."""
    return _measure(case, scan, events_for(case.depth, scan))


def measure_pass(case: Case, scan: Scan) -> list[Row]:
    """As `measure_depth`, over all of a pass: what windows learn of the patch counts."""
    return _measure(case, scan, scan.even)


def _measure(case: Case, scan: Scan, events: EventArray) -> list[Row]:
    settings = case.depth
    surface = isinstance(settings, SurfaceSettings)
    if not surface:  # each window by itself
        settings = settings.changed({"window.overlap": 0.0})
    tally: Any = SurfaceTally(scan.truth) if surface else TruthTally(scan.truth)
    spent: list[float] = []
    whole_ms = whole_cpu_ms = 0.0
    stages: dict[str, float] = defaultdict(float)
    used, windows, refused = len(events), 0, 0
    for found, ms, cpu_ms in _timed(results_of(settings, scan, events)):
        whole_ms, whole_cpu_ms = whole_ms + ms, whole_cpu_ms + cpu_ms
        if isinstance(found, RefusedWindow):
            used, refused = used - found.events, refused + 1
            continue
        windows += 1
        for stage, spent_ms in found.stage_cpu_ms.items():
            stages[stage] += spent_ms
        tally.add(found)
        if not isinstance(found, SurfacePatch) or _over_object(found, scan):
            spent.append(ms)
    row = {"object": scan.name, "events": used, "windows": windows, "refused": refused}
    row |= object_errors(tally.summary(), scan.name)
    row |= time_columns(spent) | {"cpu_ms": round(whole_cpu_ms / max(windows, 1), 3)}
    row["spent_ms"] = round(whole_ms, 3)
    for name, value in (("ms_per_mev", whole_ms), ("cpu_ms_per_mev", whole_cpu_ms)):
        row[name] = round(value / max(used * 1e-6, 1e-9), 3)
    stages["other"] = whole_cpu_ms - sum(stages.values())
    for stage in STAGES:
        if stage in stages:
            row[STAGE_COLUMNS[stage]] = round(stages[stage] * 1e6 / max(used, 1), 2)
    return [row]


def measure_plate(case: Case, scan: Scan) -> list[Row]:
    """Errors of the stitched surface: over all that lies on a plate, and by object.

    The plate's row of equal lines holds the `spread_um` of all heights on their tops.
    """
    tally = stitched(case, scan)
    summary, tops = tally.summary(), []
    rows: list[Row] = [{"object": "plate", **object_errors(summary, "plate")}]
    for name, region in scan.truth.objects.items():
        heights, measured = tops_of(tally.points, region)
        tops.append((heights, measured))
        row = {"object": name, **object_errors(summary, name)}
        row["top_um"] = round(float(heights.mean() * 1e6), 1) if len(heights) else None
        rows.append(row | {"top_points": len(heights), "tops_measured": round(measured, 4)})
    if scan.name == "three_lines":
        every = np.concatenate([heights for heights, _ in tops])
        rows[0]["spread_um"] = round(float(every.std() * 1e6), 2) if len(every) else None
        rows[0]["tops_measured"] = round(float(np.mean([share for _, share in tops])), 4)
    return [{**row, "events": len(scan.even)} for row in rows]


def stitched(case: Case, scan: Scan) -> SurfaceTally:
    """The surface of a whole pass, as the graph makes it, against the truth."""
    depth: dict[str, Any] = {"method": case.method}
    changes = {"threads": 1, **case.settings}
    surface = SurfaceParameters.create({"threads": 1})
    if case.method == "surface":
        surface = SurfaceParameters.create(changes)
    else:
        depth = {**METHODS[case.method], **changes}
    settings = replace(PipelineSettings.load(), depth=EmvsParameters.create(depth), surface=surface)
    pipeline = Pipeline(settings, scan.camera, scan.track, braille=False)
    pipeline.add_events(scan.even)
    tally = SurfaceTally(scan.truth, regions={"plate": _plate(scan), **scan.truth.objects})
    for result in pipeline.results(flush=True):
        if isinstance(result.found, SurfacePatch):
            tally.add(result.found)
        elif isinstance(result.found, Patch):
            tally.add_points(result.found.points, result.outputs[0].t_ns)
    return tally


def tops_of(
    points: npt.NDArray[np.float64], region: Region
) -> tuple[npt.NDArray[np.float64], float]:
    """What was found on top of what stands in a region, away from its walls.

    Returns
    -------
    heights : ndarray of float64, shape (n,)
        Metres.
    measured : float
        Share of the top, in cells of 0.1 mm, that holds a point.
    """
    low = np.array([region.x0, region.y0]) + _TOP_M
    high = np.array([region.x1, region.y1]) - _TOP_M
    inside = ((points[:, :2] >= low) & (points[:, :2] < high)).all(axis=1)
    cells = np.unique(np.floor((points[inside, :2] - low) / _TOP_CELL_M).astype(int), axis=0)
    count = np.ceil((high - low) / _TOP_CELL_M - 1e-6).prod()
    return np.asarray(points[inside, 2]), float(len(cells) / max(count, 1.0))


def pictured(case: Case, scan: Scan) -> dict[str, npt.NDArray[np.generic]]:
    """What pictures of an object are drawn from: its points, shape (n, 3), and a depth map.

    The depth map is that of the window with most points, with the truth beside it; `surface`
    makes none.
    """
    points, plate = stitched(case, scan).points, _plate(scan)
    near = points[plate.contains(points[:, 0], points[:, 1])].astype(np.float32)
    out: dict[str, npt.NDArray[np.generic]] = {"points": near}
    found = results_of(case.depth, scan, events_for(case.depth, scan))
    maps = [depth_map for depth_map in found if isinstance(depth_map, DepthMap)]
    if maps:
        best = max(maps, key=lambda depth_map: depth_map.points)
        seen_ns = best.stamp_ns - scan.truth.event_delay_ns
        truth, contact = scan.truth.seen_images(seen_ns)
        out |= {"depth": best.depth, "truth": np.where(contact, truth, np.nan).astype(np.float32)}
    return out


def warm_up(case: Case, scan: Scan) -> None:
    """Compile what a case needs: by all of it, as blocks with few events go other ways."""
    if case.measure in TIMED:
        events = scan.even if case.measure == "pass" else events_for(case.depth, scan)
        for _ in results_of(case.depth, scan, events):
            pass


def events_for(settings: DepthSettings | SurfaceSettings, scan: Scan) -> EventArray:
    """Events of a scan that a method is measured on."""
    # Rows of the surface are measured over their whole crossing of the image.
    return scan.even if isinstance(settings, SurfaceSettings) else scan.crossing


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


def _timed(results: Iterator[Any]) -> Iterator[tuple[Any, float, float]]:
    """Results and the wall and processor ms of each, from events that wait; cutting counts too."""
    while True:
        wall, cpu = time.perf_counter(), time.process_time()
        found = next(results, None)
        cpu_ms, ms = 1e3 * (time.process_time() - cpu), 1e3 * (time.perf_counter() - wall)
        if found is None:
            return
        yield found, ms, cpu_ms


def _over_object(found: SurfacePatch, scan: Scan) -> bool:
    """Whether a block lies where depth maps are made too, not on the bare plate around it."""
    region = scan.truth.objects.get(scan.name)
    if region is None or not len(found):
        return region is None
    middle = 0.5 * (region.x0 + region.x1)
    return bool(abs(np.median(found.points[:, 0]) - middle) <= 0.5 * CROSSING_M)


def _plate(scan: Scan) -> Region:
    """The rectangle around all that lies on the plate."""
    r = list(scan.truth.objects.values())
    x0, y0 = min(o.x0 for o in r) - _AROUND_M, min(o.y0 for o in r) - _AROUND_M
    x1, y1 = max(o.x1 for o in r) + _AROUND_M, max(o.y1 for o in r) + _AROUND_M
    return Region("plate", x0, x1, y0, y1)


#: Measures by the name that a case gives them: a scan in, rows out.
MEASURES: dict[str, Callable[[Case, Scan], list[Row]]] = {
    "depth": measure_depth,
    "pass": measure_pass,
    "plate": measure_plate,
    "coverage": measure_coverage,
    "map": measure_map,
    "detection": measure_detection,
    "weights": measure_weights,
    "window": measure_window,
    "fixed_window": measure_fixed_window,
    "braille": measure_braille,
}
