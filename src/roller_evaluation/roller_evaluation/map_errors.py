"""The height map of a single object against its truth, and against linear interpolation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import CONTINUED, MEASURED, OUTSIDE
from roller_inspect.references import SelfReference
from roller_inspect.surface_inspector import InspectionSettings, SurfaceInspector

from .cases import Case
from .plate_surface import surface_patches
from .rows import Row, mean, mean_of, where
from .scans import Scan
from .tables import Table, number, share

#: A cell further off than this is wrong, µm.
_WRONG_UM = 100.0
#: Points nearer to each other than this are one to the triangulation, m.
_SAME_M = 2e-5


def measure_map(case: Case, scan: Scan) -> list[Row]:
    """Errors of all cells over an object, of those measured and continued, and of a linear map."""
    inspector = SurfaceInspector(InspectionSettings.create({}), SelfReference())
    patches = list(surface_patches(case, scan, for_inspection=True))
    for patch in patches:
        inspector.add(patch)
    found, region = inspector.finish().height_map, scan.truth.objects[scan.name]
    row: Row = {"object": scan.name, "cells": 0}
    if found is None:
        return [row]
    place = found.in_base(*np.meshgrid(found.x_m, found.y_m), np.nan_to_num(found.height_m))
    seen = region.contains(place[..., 0], place[..., 1]) & (found.state != OUTSIDE)
    place, state = place[seen], found.state[seen]
    row["cells"] = len(place)
    if not len(place):
        return [row]
    points = np.concatenate([patch.points for patch in patches])
    truth = scan.truth.height_at(place[:, 0], place[:, 1])
    error = np.abs(place[:, 2] - truth) * 1e6
    linear = np.abs(_linear(points, place[:, :2]) - truth) * 1e6
    of = {"map": error, "linear": linear}
    of |= {n: error[state == s] for n, s in (("measured", MEASURED), ("continued", CONTINUED))}
    for name, errors in of.items():
        row[f"{name}_share"] = round(len(errors) / len(place), 4)
        if len(errors):
            row[f"{name}_mae_um"] = round(float(errors.mean()), 2)
            row[f"{name}_within"] = round(float((errors <= _WRONG_UM).mean()), 4)
    return [row]


def _linear(points: F64, place: npt.NDArray[np.float64]) -> F64:
    """Heights between points: linear in their triangles, the nearest point's beyond them."""
    _, one = np.unique(np.round(points[:, :2] / _SAME_M), axis=0, return_index=True)
    plane, height = points[one, :2], points[one, 2]
    found = LinearNDInterpolator(plane, height)(place)
    return np.where(np.isfinite(found), found, NearestNDInterpolator(plane, height)(place))


def map_table(
    rows: Sequence[Row], objects: Sequence[str], lights: Sequence[str], speed: float
) -> Table:
    """Height maps of the objects, by light."""
    cells = []
    for light in lights:
        mine = where(rows, measure="map", light=light, speed=speed)
        each = [where(mine, scene=name) for name in objects]
        for name, own in (*zip(objects, each, strict=True), ("all", None)):
            label = name if light == "ring" else f"{name}, {light}"
            cells.append((label, *_figures([own] if own is not None else each)))
    head = ("object", "map", "linear", "measured", "continued")
    note = (
        "Mean absolute error of all cells over an object, µm, with the share within 100 µm: of the "
        "inspection's height map, guesses included, and of heights linear between the points of "
        "`surface`. Of the cells called measured and continued their share of all, and the same "
        "figures; the rest is said to be unmeasured. On this coating flat ground makes no events: "
        "between its borders all is guessed, and how triangles happen to fall there changes what a "
        "linear map errs by (on the hexagon by 3 µm); so these are means of twice as many passes."
    )
    return Table(f"Height maps on the plain coating, {speed:g} m/s, µm", head, cells, note)


def _figures(each: Sequence[Sequence[Row]]) -> list[str]:
    """A table's cells from each object's rows."""
    out = []
    for name in ("map", "linear", "measured", "continued"):
        um, within, seen = (
            mean_of(mean(own, f"{name}_{column}") for own in each)
            for column in ("mae_um", "within", "share")
        )
        text = f"{number(um)} ({share(within)})" if um is not None else "–"
        out.append(text if name in ("map", "linear") else f"{share(seen)}: {text}")
    return out
