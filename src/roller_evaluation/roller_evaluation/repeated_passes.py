"""One rolling pass over a scene of the virtual cell, measured with every method."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.depth_stage import EmvsParameters
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings
from roller_emvs.patch import Patch
from roller_emvs.surface_stage import SurfaceParameters
from roller_emvs.windows import RefusedWindow
from roller_evaluation.bench.measure import events_for, of_object, results_of, tally_for
from roller_evaluation.bench.scans import Scan, get_scan
from roller_inspect.pipeline import Inspection, InspectionSettings
from roller_inspect.results.truth_tally import SurfaceTally
from roller_sim.relief import Region

from .weights import weight_errors

_FIVE = (0.0, 0.25, 0.5, 0.75, 1.0)
#: Settings of the methods; all else is default.
METHODS: dict[str, dict[str, Any]] = {
    # Not a method: bma with all weights.
    "weights": {"method": "bma"},
    "emvs": {"method": "emvs"},
    "left_right": {"method": "left_right"},
    "bma": {"method": "bma"},
    # The paper doesn't give the weights of its five views.
    "bma_5": {"method": "bma", "paper.reference_views": _FIVE, "paper.weights": (0.2,) * 5},
    "focus": {"method": "focus"},
    "surface": {"method": "surface"},
}
#: Around what lies on a plate, what of it counts, m.
_AROUND_M = 0.001
#: What of a line's top counts, away from its walls, m.
_TOP_M = 0.0002
#: Cells in which tops are covered, metres.
_TOP_CELL_M = 1e-4


@dataclass(frozen=True)
class Pass:
    """A scan and how it is measured.

    Attributes
    ----------
    scene : str
        Scene of the virtual cell.
    speed : float
        m/s.
    seed : int
        Seed of all chance.
    contact : str
        How hard the roller is pressed: light, medium or full.
    whole : bool
        Measure the stitched surface of the whole plate; else depth maps over the object.
    """

    scene: str
    speed: float
    seed: int
    contact: str = "full"
    whole: bool = False

    @property
    def name(self) -> str:
        """Name for files."""
        return f"{self.scene}_{self.speed:g}_{self.contact}_{self.seed}"


def settings_of(method: str, threads: int = 1) -> DepthSettings | SurfaceSettings:
    """Settings of one of `METHODS`."""
    if method == "surface":
        return SurfaceSettings.create({"threads": threads})
    return DepthSettings.create({**METHODS[method], "threads": threads})


def cell_changes(asked: Pass, cell: Mapping[str, Any], threads: int = 1) -> dict[str, Any]:
    """Settings of the virtual cell that a pass asks for."""
    skin = {**cell.get("skin", {}), "contact": asked.contact}
    return {**cell, "seed": asked.seed, "threads": threads, "skin": skin}


def scan_of(asked: Pass, cell: Mapping[str, Any], threads: int = 1) -> Scan:
    """Simulate a pass and read it as a recording is read."""
    with tempfile.TemporaryDirectory() as folder:
        changes = cell_changes(asked, cell, threads)
        return get_scan(Path(folder), asked.scene, asked.speed, changes)


def measure_pass(asked: Pass, methods: Iterable[str], cell: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of a pass: its events, and errors with their coverage by method.

    Parameters
    ----------
    asked : Pass
        The pass.
    methods : iterable of str
        Of `METHODS`.
    cell : mapping
        Settings of the virtual cell that differ from the defaults.
    """
    scan = scan_of(asked, cell)
    measure = measure_whole if asked.whole else measure_object
    return {
        "pass": asdict(asked),
        "events": len(scan.events),
        "methods": {method: measure(scan, method) for method in methods},
    }


def measure_object(scan: Scan, method: str) -> dict[str, Any]:
    """Errors of a method's depth maps, or rows, while the object crosses the image."""
    settings = settings_of(method)
    if method == "weights":
        assert isinstance(settings, DepthSettings)
        return weight_errors(scan, settings)
    tally, windows = tally_for(settings, scan), 0
    for found in results_of(settings, scan, events_for(settings, scan)):
        if not isinstance(found, RefusedWindow):
            tally.add(found)
            windows += 1
    return of_object(tally.summary(), scan.name) | {"windows": windows}


def measure_whole(scan: Scan, method: str) -> dict[str, Any]:
    """Errors of the stitched surface over all that lies on a plate, and by object."""
    tally = stitched(scan, method)
    summary = tally.summary()
    out = of_object(summary, "plate")
    out["objects"] = {name: of_object(summary, name) for name in scan.truth.objects}
    tops = [tops_of(tally.points, region) for region in scan.truth.objects.values()]
    out["tops_um"] = [
        {"mean": round(float(z.mean() * 1e6), 1), "points": len(z), "measured": round(share, 4)}
        if len(z)
        else None
        for z, share in tops
    ]
    if scan.name == "three_lines":
        heights = np.concatenate([z for z, _ in tops])
        out["spread_um"] = round(float(heights.std() * 1e6), 2) if len(heights) else None
        out["tops_measured"] = round(float(np.mean([share for _, share in tops])), 4)
    return out


def stitched(scan: Scan, method: str) -> SurfaceTally:
    """The surface of a whole pass, as the graph makes it, against the truth."""
    settings = replace(
        InspectionSettings.load(),
        depth=EmvsParameters.create({**METHODS[method], "threads": 1}),
        surface=SurfaceParameters.create({"threads": 1}),
    )
    inspection = Inspection(settings, scan.camera, scan.track, braille=False)
    inspection.add_events(scan.events)
    tally = SurfaceTally(scan.truth, regions={"plate": _plate(scan), **scan.truth.objects})
    for result in inspection.results(flush=True):
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


def pictured(scan: Scan, method: str) -> dict[str, npt.NDArray[np.generic]]:
    """What pictures of an object are drawn from: its points, shape (n, 3), and a depth map.

    The depth map is that of the window with most points, with the truth beside it; `surface`
    makes none.
    """
    settings = settings_of(method)
    if isinstance(settings, SurfaceSettings):
        return {"points": _near(scan, stitched(scan, method).points)}
    maps = [
        found
        for found in results_of(settings, scan, events_for(settings, scan))
        if isinstance(found, DepthMap)
    ]
    out: dict[str, npt.NDArray[np.generic]] = {"points": _near(scan, stitched(scan, method).points)}
    if maps:
        best = max(maps, key=lambda found: found.points)
        seen_ns = best.stamp_ns - scan.truth.event_delay_ns
        truth = np.where(
            scan.truth.contact_mask(seen_ns), scan.truth.depth_image(seen_ns), np.nan
        ).astype(np.float32)
        out |= {"depth": best.depth, "truth": truth}
    return out


def _near(scan: Scan, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    plate = _plate(scan)
    return points[plate.contains(points[:, 0], points[:, 1])].astype(np.float32)


def _plate(scan: Scan) -> Region:
    """The rectangle around all that lies on the plate."""
    regions = list(scan.truth.objects.values())
    return Region(
        "plate",
        min(r.x0 for r in regions) - _AROUND_M,
        max(r.x1 for r in regions) + _AROUND_M,
        min(r.y0 for r in regions) - _AROUND_M,
        max(r.y1 for r in regions) + _AROUND_M,
    )
