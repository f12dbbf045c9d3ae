"""The report's map of deviations, and how they are distributed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from roller_inspect.height_map.height_map import CONTINUED, F32, HeightMap

from .html import signed
from .pictures import data_uri, map_picture
from .svg import Chart

#: A row of the map holds so much length at least, m, and the page so many rows at most.
_ROW_M, _MOST_ROWS = 0.12, 12
_MAP_PX = 860


@dataclass(frozen=True)
class Pictured:
    """What the page shows beside the words of `inspection.json`."""

    #: The map.
    height_map: HeightMap
    #: From the reference, metres. Shape (ny, nx).
    deviation_m: F32
    #: Depth that most of the part may have; the scale of colours is twice that.
    tolerance_m: float


def map_section(document: Mapping[str, Any], pictured: Pictured) -> str:
    """Map of deviations with the findings' outlines, and the histogram."""
    grid, deviation = pictured.height_map, pictured.deviation_m
    length = float(grid.x_m[-1] - grid.x_m[0]) + grid.step_m
    rows = min(_MOST_ROWS, max(1, math.ceil(length / _ROW_M)))
    scale = 2 * pictured.tolerance_m
    charts = []
    for columns in np.array_split(np.arange(len(grid.x_m)), rows):
        piece = slice(int(columns[0]), int(columns[-1]) + 1)
        part = grid.cropped(piece, slice(None))
        chart = axes(part, _MAP_PX)
        chart.image(data_uri(map_picture(deviation[:, piece], part.state, scale, _MAP_PX)))
        for f in document["findings"]:
            x, y = local(grid, f["outline_m"])
            if x.max() >= part.x_m[0] and x.min() <= part.x_m[-1]:
                chart.outline(x * 1e3, y * 1e3, f"found {f['verdict']}", str(f["id"]))
        charts.append(str(chart))
    t = pictured.tolerance_m * 1e6
    legend = (
        f'<p class="legend"><i class="ramp"></i> −{2 * t:.0f} … +{2 * t:.0f} µm from the reference '
        f"(pale within ±{t:.0f} µm); <i class='hatch'></i> not measured; white: outside the scan. "
        "+ is extra material, − missing.</p>"
    )
    return (
        "<section><h2>Deviation</h2>"
        + "".join(charts)
        + legend
        + _histogram(pictured)
        + "</section>"
    )


def _histogram(pictured: Pictured) -> str:
    """Deviation of cells that were measured or continued, with the tolerance as a band."""
    values = pictured.deviation_m[pictured.height_map.state >= CONTINUED] * 1e6
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    t = pictured.tolerance_m * 1e6
    reach = max(2.5 * t, float(np.percentile(np.abs(values), 99.8)))
    counts, edges = np.histogram(values.clip(-reach, reach), 81, (-reach, reach))
    share = counts / len(values) * 100
    # A root shows the few cells that are off beside the many that are not.
    top = float(np.sqrt(share.max()))
    chart = Chart((-reach, reach), (0, top * 1.05), "deviation, µm", "√ of % of cells", 860, 180)
    chart.band(-t, t, along="x")
    chart.bars(edges.tolist(), np.sqrt(share).tolist())
    within = float((np.abs(values) <= t).mean())
    middle, spread = (
        float(np.median(values)),
        float(1.4826 * np.median(np.abs(values - np.median(values)))),
    )
    words = (
        f"{len(values):,} cells; median {signed(middle)} µm, robust spread {spread:.1f} µm; "
        f"{within:.2%} within ±{t:.0f} µm; what is beyond the ends is in the last bars."
    )
    return f'<h3>Distribution</h3>{chart}<p class="legend">{words}</p>'


def axes(part: HeightMap, width: int) -> Chart:
    """Axes of a part of the map, so many pixels wide."""
    half = part.step_m / 2
    x, y = ((float(a[0]) - half, float(a[-1]) + half) for a in (part.x_m, part.y_m))
    mm = [(a * 1e3, b * 1e3) for a, b in (x, y)]
    return Chart(mm[0], mm[1], "x, mm", "y, mm", width, equal=True)


def local(grid: HeightMap, outline_m: Iterable[Iterable[float]]) -> tuple[np.ndarray, np.ndarray]:
    """A polygon of base in the map's frame: x and y, metres."""
    points = np.asarray(list(outline_m), float).reshape(-1, 3)
    rotation, shift = grid.base_from_map[:3, :3], grid.base_from_map[:3, 3]
    local = (points - shift) @ rotation
    return local[:, 0], local[:, 1]
