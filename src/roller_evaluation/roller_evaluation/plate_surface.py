"""The surface of a whole plate, and how much of it is measured, how well, at what event rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_sim.relief import Region

from .cases import Case
from .rows import Row
from .scans import Scan

#: Cells in which the plate's area is counted, m.
_CELL_M = 1e-4
#: What of the view's border and of the plate around its objects stays out, m.
_BORDER_M, _AROUND_M = 0.5e-3, 1e-3
#: Rows of the whole sensor, to which event rates are scaled.
_ROWS = 480


def surface_patches(case: Case, scan: Scan, for_inspection: bool = False) -> Iterator[SurfacePatch]:
    """The surface that `surface` finds at constant speed, the events' delay taken out."""
    settings, truth = case.depth, scan.truth
    assert isinstance(settings, SurfaceSettings)
    if for_inspection:
        settings = settings.changed({"average_flats": False})
    sweep = SurfaceSweep(settings, scan.camera, scan.track)
    sweep.add_events(scan.even)
    for found in sweep.results(flush=True):
        if isinstance(found, SurfacePatch) and len(found):
            stamps = [found.stamp_ns - truth.event_delay_ns, found.stamp_ns]
            before, after = truth.camera_positions(stamps)
            yield replace(found, points=found.points - (after - before))


def seen_area(scan: Scan) -> Region:
    """The plate around its objects, as wide as the view."""
    camera, objects = scan.camera, scan.truth.objects.values()
    half = camera.height / 2 / camera.fy * scan.truth.path.height_m - _BORDER_M
    y = float(scan.truth.origin_m[1])
    x0 = min(o.x0 for o in objects) - _AROUND_M
    return Region("plate", x0, max(o.x1 for o in objects) + _AROUND_M, y - half, y + half)


def measure_coverage(case: Case, scan: Scan) -> list[Row]:
    """Errors, share of cells of 0.1 mm with a point, points by area, and the rate of events."""
    area = seen_area(scan)
    found = [patch.points for patch in surface_patches(case, scan)]
    points = np.concatenate(found) if found else np.empty((0, 3))
    points = points[area.contains(points[:, 0], points[:, 1])]
    error = np.abs(points[:, 2] - scan.truth.height_at(points[:, 0], points[:, 1])) * 1e6
    shape = [round((b - a) / _CELL_M) for a, b in ((area.x0, area.x1), (area.y0, area.y1))]
    cells = np.unique(((points[:, :2] - (area.x0, area.y0)) / _CELL_M).astype(int), axis=0)
    first, last = scan.truth.path.even_s
    rate = len(scan.even) / (last - first) * _ROWS / scan.camera.height
    row: Row = {
        "points": len(points),
        "points_per_mm2": round(len(points) / float(np.prod(shape) * _CELL_M**2 * 1e6), 2),
        "measured": round(len(cells) / float(np.prod(shape)), 4),
        "mev_per_s": round(rate * 1e-6, 3),
    }
    p90 = partial(np.quantile, q=0.9)
    for name, figure in (("mae_um", np.mean), ("median_um", np.median), ("p90_um", p90)):
        row[name] = round(float(figure(error)), 2) if len(error) else None
    return [row]
