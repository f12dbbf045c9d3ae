"""The picture of a run: depth, cloud from above and in profile, error, text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import inverse_pose
from roller_emvs.ply import read_ply
from roller_inspect.height_map import HeightMap
from roller_inspect.report.pictures import colour
from roller_sim.truth import Truth
from roller_sim.truth_files import truth_beside

from .depth_row import chosen_stamps, draw_depths
from .drawing import BLACK, BLUE, GREY, LIGHT, TITLE, Panel, Picture, colours, scale_bar
from .layout import LEFT, RIGHT, SCALE, WIDTH, columns, limits

F64 = npt.NDArray[np.float64]

_MOST_POINTS = 400_000
_HEIGHT_CHART = cv2.COLORMAP_VIRIDIS
#: Deviation of the last colours of what was inspected, µm.
_DEVIATION_UM = 300
#: Sigma from which on a point of the profile is drawn as unsure, m.
_UNSURE_M = 1e-4
#: Pixels: heights of the rows of panels; room for the title, and between rows; for the text read.
_DEPTHS, _ABOVE, _CHARTS, _HEAD, _GAP, _TEXT = 275, 215, 250, 70, 88, 60


def draw_overview(folder: Path, source: Path, bag: Path | None = None) -> Path:
    """Draw `overview.png` from the files of a run.

    Parameters
    ----------
    folder : path
        Output folder of a run, finished.
    source : path
        Its input; a simulated scan has its truth beside it.
    bag : path, optional
        Where the depth images are; `result/` of the folder by default.

    Returns
    -------
    path
        The picture.
    """
    report = json.loads((folder / "report.json").read_text())
    truth = truth_beside(source)
    delay_ns = _delay_left_ns(report, truth)
    cloud = _thinned(read_ply(folder / "surface.ply"))
    stamps = chosen_stamps(report)  # some methods make no depth maps
    rows = [_DEPTHS, _ABOVE, _CHARTS] if stamps else [_ABOVE, _CHARTS]
    picture = Picture(WIDTH, _HEAD + sum(rows) + _GAP * len(rows) + _TEXT - 30)
    top = _HEAD
    if stamps:
        draw_depths(picture, top, _DEPTHS, bag or folder / "result", stamps, truth, delay_ns)
        top += _DEPTHS + _GAP
    _draw_above(picture, top, cloud)
    top += _ABOVE + _GAP
    inspected = (folder / "inspection.json").exists()
    boxes = [
        (left, top, right, top + _CHARTS)
        for left, right in columns([2, 2, 2] if inspected else [4, 2])
    ]
    _draw_profile(picture, boxes[0], cloud, truth, delay_ns)
    if inspected:
        _draw_inspection(picture, boxes[1], folder)
    _draw_errors(picture, boxes[-1], report)
    _draw_text(picture, top + _CHARTS + _GAP - 30, report)
    totals = report["totals"]
    kind = "block" if report["method"] == "surface" else "depth map"
    maps = f"{totals['depth_windows']} {kind}{'s' if totals['depth_windows'] != 1 else ''}"
    picture.text(
        WIDTH / 2,
        14,
        f"{report['title']}: {maps} by {report['method']}, "
        f"{totals['surface_points']} surface points, edge drift {report['edge_drift']}",
        size=TITLE,
    )
    path = folder / "overview.png"
    picture.save(path)
    return path


def _thinned(cloud: dict[str, F64]) -> dict[str, F64]:
    n = len(cloud["x"])
    if n <= _MOST_POINTS:
        return cloud
    chosen = np.random.default_rng(0).choice(n, _MOST_POINTS, replace=False)
    return {name: column[chosen] for name, column in cloud.items()}


def _delay_left_ns(report: dict[str, Any], truth: Truth | None) -> int:
    """Delay of event stamps that the settings have not taken out."""
    if truth is None:
        return 0
    section = report["settings"].get("surface" if report["method"] == "surface" else "emvs", {})
    return truth.event_delay_ns - round(section.get("event_delay_s", 0.0) * 1e9)


def _draw_above(picture: Picture, top: int, cloud: dict[str, F64]) -> None:
    box, title = (LEFT, top, RIGHT, top + _ABOVE), "surface from above"
    if not len(cloud["x"]):
        panel = Panel(picture, box, (0, 1), (0, 1), title)
        panel.label(0.5, 0.5, "no surface points", "mm")
        panel.close(x_ticks=False, y_ticks=False)
        return
    x, y, height = (cloud[name] * 1e3 for name in ("x", "y", "height"))
    low, high = limits(height)
    panel = Panel(
        picture, box, (x.min(), x.max()), (y.min(), y.max()), title, "x, mm", "y, mm", equal=True
    )
    # The highest point of each pixel.
    place = np.floor(panel.places(x, y)).astype(np.int64)
    column, row = place[:, 0].clip(0, panel.width - 1), place[:, 1].clip(0, panel.height - 1)
    highest = np.full((panel.height, panel.width), np.nan)
    np.fmax.at(highest, (row, column), height)
    panel.rgb[:] = colours(highest, low, high, _HEIGHT_CHART)
    panel.close()
    scale_bar(
        picture, (SCALE[0], top, SCALE[1], top + _ABOVE), low, high, _HEIGHT_CHART, "height, mm"
    )


def _draw_profile(
    picture: Picture,
    box: tuple[int, int, int, int],
    cloud: dict[str, F64],
    truth: Truth | None,
    delay_ns: int,
) -> None:
    texts = "profile along the middle", "x, mm", "height, mm"
    if not len(cloud["x"]):
        Panel(picture, box, (0, 1), (0, 1), *texts).close(x_ticks=False, y_ticks=False)
        return
    middle = float(np.median(cloud["y"]))
    if truth is not None and truth.objects:
        regions = truth.objects.values()
        middle = float(np.mean([(r.y0 + r.y1) / 2 for r in regions]))
    width = 0.02 * max(float(np.ptp(cloud["y"])), 1e-6)
    band = np.abs(cloud["y"] - middle) < width
    x, height = cloud["x"][band] * 1e3, cloud["height"][band] * 1e3
    unsure = cloud["sigma"][band] > _UNSURE_M
    left, right = float(cloud["x"].min()) * 1e3, float(cloud["x"].max()) * 1e3
    low, high = (height.min(), height.max()) if len(height) else (0.0, 1.0)
    if truth is not None:
        along = np.linspace(left, right, 4000)
        # The travel during that delay is behind the sensor.
        delay_m = truth.settings.motion.speed * delay_ns * 1e-9
        true = truth.height_at(along * 1e-3 - delay_m, np.full_like(along, middle))
        true = (true - truth.origin_m[2]) * 1e3
        low, high = true.min() - 0.4, true.max() + 0.4
    margin = 0.03 * (right - left)
    panel = Panel(picture, box, (left - margin, right + margin), (low, high), *texts)
    panel.dots(x[unsure], height[unsure], LIGHT)
    panel.dots(x[~unsure], height[~unsure])
    names = [("measured", BLUE)]
    if unsure.any():
        names.append((f"σ > {_UNSURE_M * 1e3:g} mm", LIGHT))
    if truth is not None:
        panel.line(along, true)
        names.append(("truth (skin)", BLACK))
    panel.legend(names)
    panel.close()


def _draw_inspection(picture: Picture, box: tuple[int, int, int, int], folder: Path) -> None:
    """Height over the middle of what was inspected, and the findings' outlines and depths."""
    document = json.loads((folder / "inspection.json").read_text())
    grid = HeightMap.load(folder / "height_map.npz")
    recipe = document["recipe"]
    boxes = [recipe["regions"][name]["box_m"] for name in recipe["inspect"]]
    corners = np.array([box for box in boxes if box] or [_bounds(grid)])
    (left, bottom), (right, top) = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    panel = Panel(
        picture,
        box,
        (left * 1e3, right * 1e3),
        (bottom * 1e3, top * 1e3),
        f"inspected: {document['verdict']}; µm, colours to ±{_DEVIATION_UM}",
        "x, mm",
        "y, mm",
        equal=True,
    )
    # The map lies along the roll; the picture, along x.
    x, y = np.meshgrid(
        left + (np.arange(panel.width) + 0.5) / panel.width * (right - left),
        top - (np.arange(panel.height) + 0.5) / panel.height * (top - bottom),
    )
    map_from_base = inverse_pose(grid.base_from_map)
    a, b = np.tensordot(map_from_base[:2, :2], [x, y], 1) + map_from_base[:2, 3, None, None]
    column = np.searchsorted(grid.x_m, a).clip(0, len(grid.x_m) - 1)
    row = np.searchsorted(grid.y_m, b).clip(0, len(grid.y_m) - 1)
    um = np.where(grid.known, grid.height_m, np.nan)[row, column] * 1e6
    if np.isfinite(um).any():
        um -= np.nanmedian(um)
    panel.rgb[:] = colour(um, _DEVIATION_UM)
    panel.rgb[np.isnan(um)] = LIGHT
    for f in document["findings"]:
        outline = np.array([*f["outline_m"], f["outline_m"][0]])[:, :2] * 1e3
        panel.line(*outline.T)
        at = f["center_m"][0] * 1e3, f["center_m"][1] * 1e3
        panel.label(*at, f"{f['depth_m'] * 1e6:+.0f}".replace("-", "−"), "mm")
    panel.close()


def _bounds(grid: HeightMap) -> list[float]:
    """Least x and y and most x and y of a map, m in base."""
    ends = np.array([[x, y] for x in grid.x_m[[0, -1]] for y in grid.y_m[[0, -1]]])
    places = ends @ grid.base_from_map[:2, :2].T + grid.base_from_map[:2, 3]
    return [*places.min(axis=0), *places.max(axis=0)]


def _draw_errors(picture: Picture, box: tuple[int, int, int, int], report: dict[str, Any]) -> None:
    truth = report["truth"]
    if not truth:
        spent = [w["milliseconds"]["total"] for w in report["windows"] if w["milliseconds"]]
        texts = "time by window", "window", "ms"
        ends = (0, len(spent) - 1), (0, 1.1 * max(spent, default=1.0))
        panel = Panel(picture, box, *ends, *texts)
        panel.line(range(len(spent)), spent, BLUE)
        panel.dots(range(len(spent)), spent)
        panel.close()
        return
    found = {k: f for k, f in truth["objects"].items() if f["points"]}
    found["all"] = truth["all"]
    names = [k for k, f in found.items() if f["points"]]
    values = [found[k]["mae_um"] for k in names]
    # From above to below.
    panel = Panel(
        picture, box, (0, max([*values, 1.0]) * 1.7), (len(names) - 0.4, -0.6),
        "mean absolute error against truth", "µm",
    )  # fmt: skip
    for n, (name, value) in enumerate(zip(names, values, strict=True)):
        panel.bar(n, 0.8, value, GREY if name == "all" else BLUE)
        label = f"{value:.0f} µm"
        if found[name]["edges_measured"] is not None:  # flat ones have none
            label += f", {found[name]['edges_measured']:.0%} of edges"
        panel.label(value, n, label, "lm", dx=4)
        panel.label(0, n, name, "rm", dx=-8)
    panel.close(y_ticks=False)


def _draw_text(picture: Picture, top: int, report: dict[str, Any]) -> None:
    lines = report["totals"]["braille_text"]
    read = " / ".join(lines) if lines else "–"
    picture.text(LEFT, top, f"text read:  {read}", "la", TITLE, fixed=True)
    if report["truth"] and report["truth"]["text"]:
        given = report["truth"]["text"].replace("\n", " / ")
        picture.text(LEFT, top + 24, f"text given: {given}", "la", TITLE, fixed=True)
