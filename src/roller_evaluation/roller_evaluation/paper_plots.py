"""Figures of the evaluation, as PNG in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from .bench_plots import COLOURS
from .experiments import FUSIONS, EvaluationOptions
from .paper_tables import NAMES, of_object
from .pictures import png
from .rows import Row, deviation, mean

#: What the colours span beyond the relief, mm.
_AROUND_MM = 0.1
#: Depth of the plate where no depth map gives it, mm.
_MIDDLE_MM = 45.0
#: Points of a cloud that are drawn, at most.
_MOST_POINTS = 20_000


def draw_speed(rows: Sequence[Row], o: EvaluationOptions) -> bytes:
    """Error against speed on the sphere, and the share of edges measured."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.2), dpi=100, layout="constrained")
    for method in FUSIONS:
        own = [(v, of_object(rows, "sphere", method, v)) for v in o.speeds]
        own = [(v, each) for v, each in own if mean(each, "mae_um") is not None]
        x = [v for v, _ in own]
        middle = [mean(each, "mae_um") or 0.0 for _, each in own]
        about = [deviation(each, "mae_um") or 0.0 for _, each in own]
        seen = [100 * (mean(each, "edges_measured") or 0.0) for _, each in own]
        style: dict[str, Any] = {"color": COLOURS[method], "label": NAMES[method]}
        left.errorbar(x, middle, about, marker="o", ms=4, capsize=3, **style)
        right.plot(x, seen, marker="o", ms=4, **style)
    left.set(xlabel="speed, m/s", ylabel="mean absolute error, µm", ylim=(0, None))
    right.set(xlabel="speed, m/s", ylabel="relief edges measured, %", ylim=(0, 100))
    left.legend()
    for axis in (left, right):
        axis.grid(alpha=0.3)
    return png(figure)


def draw_object(pictures: Mapping[str, Mapping[str, npt.NDArray[Any]]], colours: str) -> bytes:
    """Depth maps and clouds of one object by method, as the paper shows them.

    Parameters
    ----------
    pictures : mapping
        By method, what `pictured` gives.
    colours : str
        A colour map.
    """
    figure = plt.figure(figsize=(4.2 * len(pictures), 10.5), dpi=80, layout="constrained")
    grid = figure.add_gridspec(3, len(pictures), height_ratios=(3, 3, 4))
    truths = [p["truth"] for p in pictures.values() if "truth" in p]
    if truths:
        low = min(float(np.nanmin(t)) for t in truths) * 1e3
        plate = float(np.nanmedian(truths[0])) * 1e3
    else:
        low, plate = _MIDDLE_MM - 1.0, _MIDDLE_MM
    limits = (low - _AROUND_MM, plate + _AROUND_MM)
    shown = None
    for column, (method, picture) in enumerate(pictures.items()):
        for row, (name, what) in enumerate((("truth", "truth in contact"), ("depth", "depth map"))):
            axis = figure.add_subplot(grid[row, column])
            axis.set_axis_off()
            if name in picture:
                axis.set_title(f"{NAMES[method]}: {what}", fontsize=10)
                shown = axis.imshow(
                    picture[name] * 1e3, cmap=colours, vmin=limits[0], vmax=limits[1],
                    interpolation="nearest",
                )  # fmt: skip
        cloud = figure.add_subplot(grid[2, column], projection="3d")
        cloud.set_title(f"{NAMES[method]}: cloud", fontsize=10)
        points_mm = np.asarray(picture["points"], np.float64) * 1e3
        _draw_cloud(cloud, points_mm, colours, (plate - limits[1], plate - limits[0]))
    if shown is not None:
        figure.colorbar(shown, ax=figure.axes, location="bottom", label="depth, mm", shrink=0.4)
    return png(figure)


def _draw_cloud(
    axis: Any, points_mm: npt.NDArray[np.float64], colours: str, heights_mm: tuple[float, float]
) -> None:
    axis.view_init(elev=55, azim=-80)
    axis.tick_params(labelsize=7, pad=-2)
    if not len(points_mm):
        return
    step = max(1, len(points_mm) // _MOST_POINTS)
    x, y, z = points_mm[::step].T
    # What is higher is nearer to the camera: the colours of the depth maps.
    axis.scatter(x, y, z, c=-z, s=0.3, lw=0, cmap=colours, vmin=-heights_mm[1], vmax=-heights_mm[0])
    axis.set_box_aspect((np.ptp(x) or 1, np.ptp(y) or 1, 3.5), zoom=1.2)
    axis.set_zlim(heights_mm)
    axis.set_zticks([])
