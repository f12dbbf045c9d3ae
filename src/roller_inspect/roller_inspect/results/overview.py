"""The picture of a run: depth, cloud from above and in profile, error, text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rosbags.rosbag2 import Reader

from roller_core.bags import typestore
from roller_core.transforms import inverse_pose
from roller_emvs.ply import read_ply
from roller_inspect.height_map import HeightMap
from roller_sim.truth import Truth

F64 = npt.NDArray[np.float64]

_MOST_POINTS = 400_000
#: Pixels of the longer side of the surface from above.
_PICTURE_PX = 1200
_DEPTH_MAP = "turbo_r"
_HEIGHT_MAP = "viridis"


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
    truth = Truth.beside(source)
    delay_ns = _delay_left_ns(report, truth)
    cloud = _thinned(read_ply(folder / "surface.ply"))
    # A layout that matplotlib works out takes as long as all else here.
    stamps = _chosen_stamps(report)  # some methods make no depth maps
    figure = Figure(figsize=(15, 11 if stamps else 7.5), dpi=100)
    grid = figure.add_gridspec(
        4, 7, width_ratios=[1] * 6 + [0.08],
        height_ratios=[1.25 if stamps else 0.01, 0.9, 0.8, 0.16],
        left=0.05, right=0.94, top=0.92, bottom=0.02, wspace=0.3, hspace=0.3,
    )  # fmt: skip
    if stamps:
        axes = [figure.add_subplot(grid[0, 2 * k : 2 * k + 2]) for k in range(len(stamps))]
        bar = figure.add_subplot(grid[0, 6])
        _draw_depths(axes, bar, bag or folder / "result", stamps, truth, delay_ns)
    _draw_above(figure.add_subplot(grid[1, :6]), figure.add_subplot(grid[1, 6]), cloud)
    inspected = (folder / "inspection.json").exists()
    _draw_profile(figure.add_subplot(grid[2, : 2 if inspected else 4]), cloud, truth, delay_ns)
    if inspected:
        _draw_inspection(figure.add_subplot(grid[2, 2:4]), folder)
    _draw_errors(figure.add_subplot(grid[2, 4:6]), report)
    _draw_text(figure.add_subplot(grid[3, :]), report)
    totals = report["totals"]
    kind = "block" if report["method"] == "surface" else "depth map"
    maps = f"{totals['depth_windows']} {kind}{'s' if totals['depth_windows'] != 1 else ''}"
    figure.suptitle(
        f"{report['title']}: {maps} by {report['method']}, "
        f"{totals['surface_points']} surface points, edge drift {report['edge_drift']}"
    )
    path = folder / "overview.png"
    figure.savefig(path)
    return path


def _thinned(cloud: dict[str, F64]) -> dict[str, F64]:
    n = len(cloud["x"])
    if n <= _MOST_POINTS:
        return cloud
    chosen = np.random.default_rng(0).choice(n, _MOST_POINTS, replace=False)
    return {name: column[chosen] for name, column in cloud.items()}


def _chosen_stamps(report: dict[str, Any]) -> list[int]:
    """The depth maps with most points of up to three stretches of the run."""
    if report["method"] == "surface":
        return []
    windows = [w for w in report["windows"] if w["points"]]
    most = max((w["points"] for w in windows), default=0)
    windows = [w for w in windows if w["points"] > 0.1 * most]
    chosen = []
    for part in np.array_split(np.arange(len(windows)), 3):
        if len(part):
            best = max((windows[k] for k in part), key=lambda w: w["points"])
            chosen.append(int(best["stamp_ns"]))
    return chosen


def _draw_depths(
    axes: list[Axes],
    bar: Axes,
    bag: Path,
    stamps: list[int],
    truth: Truth | None,
    delay_ns: int,
) -> None:
    images = _depth_images(bag, set(stamps))
    measured = [i[np.isfinite(i)].astype(np.float64) for i in images.values()]
    low, high = _limits(np.concatenate(measured) if measured else np.empty(0))
    picture = None
    for axis, stamp in zip(axes, stamps, strict=False):
        mm = images[stamp] * 1e3
        picture = axis.imshow(_thick(mm), cmap=_DEPTH_MAP, vmin=low * 1e3, vmax=high * 1e3)
        title = f"depth at {(stamp - stamps[0]) * 1e-9:+.3f} s"
        if truth is not None:
            error = _error_um(images[stamp], stamp, truth, delay_ns)
            if len(error):
                title += f", error {np.abs(error).mean():.0f} µm"
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("u, px")
    axes[0].set_ylabel("v, px")
    if picture is not None:
        axes[0].figure.colorbar(picture, cax=bar, label="depth, mm")


def _thick(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Points two pixels wide, so that a semi-dense map can be seen when scaled down."""
    out = image.copy()
    for shift in ((0, 1), (1, 0), (1, 1)):
        moved = np.full_like(image, np.nan)
        moved[shift[0] :, shift[1] :] = image[
            : image.shape[0] - shift[0], : image.shape[1] - shift[1]
        ]
        out = np.where(np.isnan(out), moved, out)
    return out


def _depth_images(bag: Path, stamps: set[int]) -> dict[int, npt.NDArray[np.float32]]:
    store, found = typestore(), {}
    with Reader(bag) as reader:
        wanted = [c for c in reader.connections if c.topic == "/roller/depth/image"]
        for connection, _, data in reader.messages(wanted):
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            if stamp in stamps:
                pixels = np.frombuffer(message.data, np.float32)
                found[stamp] = pixels.reshape(message.height, message.width)
    return found


def _delay_left_ns(report: dict[str, Any], truth: Truth | None) -> int:
    """Delay of event stamps that the settings have not taken out."""
    if truth is None:
        return 0
    section = report["settings"].get("surface" if report["method"] == "surface" else "emvs", {})
    return truth.event_delay_ns - round(section.get("event_delay_s", 0.0) * 1e9)


def _error_um(depth: npt.NDArray[np.float32], stamp: int, truth: Truth, delay_ns: int) -> F64:
    v, u = np.nonzero(np.isfinite(depth))
    pixels = np.stack([u, v], axis=-1)
    # Stamps are later than what caused the events by a known delay, as in `truth.py`.
    seen_ns = stamp - delay_ns
    seen, contact = truth.seen_at(seen_ns, pixels)
    return np.asarray((depth[v, u] - seen)[contact] * 1e6)


def _limits(values: F64) -> tuple[float, float]:
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, [0.5, 99.5])
    return float(low), float(max(high, low + 1e-6))


def _draw_above(axis: Axes, bar: Axes, cloud: dict[str, F64]) -> None:
    axis.set_title("surface from above", fontsize=10)
    if not len(cloud["x"]):
        axis.text(0.5, 0.5, "no surface points", ha="center", transform=axis.transAxes)
        bar.set_axis_off()
        return
    low, high = _limits(cloud["height"])
    # The highest point of each pixel; markers would take ten times as long.
    x, y = cloud["x"] * 1e3, cloud["y"] * 1e3
    left, bottom, size = x.min(), y.min(), max(np.ptp(x), np.ptp(y), 1e-3) / _PICTURE_PX
    column, row = ((x - left) / size).astype(int), ((y - bottom) / size).astype(int)
    heights = np.full((row.max() + 1, column.max() + 1), np.nan, np.float32)
    np.fmax.at(heights, (row, column), (cloud["height"] * 1e3).astype(np.float32))
    picture = axis.imshow(
        heights, origin="lower", cmap=_HEIGHT_MAP, vmin=low * 1e3, vmax=high * 1e3,
        interpolation="nearest",
        extent=(left, left + size * heights.shape[1], bottom, bottom + size * heights.shape[0]),
    )  # fmt: skip
    axis.set_xlabel("x, mm")
    axis.set_ylabel("y, mm")
    axis.figure.colorbar(picture, cax=bar, label="height, mm")


def _draw_profile(axis: Axes, cloud: dict[str, F64], truth: Truth | None, delay_ns: int) -> None:
    axis.set_title("profile along the middle", fontsize=10)
    axis.set_xlabel("x, mm")
    axis.set_ylabel("height, mm")
    if not len(cloud["x"]):
        return
    middle = float(np.median(cloud["y"]))
    if truth is not None and truth.objects:
        regions = truth.objects.values()
        middle = float(np.mean([(r.y0 + r.y1) / 2 for r in regions]))
    width = 0.02 * max(float(np.ptp(cloud["y"])), 1e-6)
    band = np.abs(cloud["y"] - middle) < width
    axis.plot(cloud["x"][band] * 1e3, cloud["height"][band] * 1e3, ".", ms=1.2, label="measured")
    if truth is not None:
        x = np.linspace(cloud["x"].min(), cloud["x"].max(), 4000)
        # The travel during that delay is behind the sensor.
        delay_m = truth.settings.motion.speed * delay_ns * 1e-9
        height = truth.height_at(x - delay_m, np.full_like(x, middle)) - truth.origin_m[2]
        axis.plot(x * 1e3, height * 1e3, "k-", lw=0.8, label="truth (skin)")
        axis.set_ylim(height.min() * 1e3 - 0.4, height.max() * 1e3 + 0.4)
    axis.legend(loc="upper right", fontsize=8, markerscale=6)


def _draw_inspection(axis: Axes, folder: Path) -> None:
    """Height over the middle of what was inspected, and the findings' outlines and depths."""
    document = json.loads((folder / "inspection.json").read_text())
    grid = HeightMap.load(folder / "height_map.npz")
    recipe = document["recipe"]
    boxes = [recipe["regions"][name]["box_m"] for name in recipe["inspect"]]
    corners = np.array([box for box in boxes if box] or [_bounds(grid)])
    (left, bottom), (right, top) = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    # The map lies along the roll; the picture, along x.
    x, y = np.meshgrid(np.arange(left, right, recipe["grid_m"]),
                       np.arange(bottom, top, recipe["grid_m"]))  # fmt: skip
    map_from_base = inverse_pose(grid.base_from_map)
    a, b = np.tensordot(map_from_base[:2, :2], [x, y], 1) + map_from_base[:2, 3, None, None]
    column = np.searchsorted(grid.x_m, a).clip(0, len(grid.x_m) - 1)
    row = np.searchsorted(grid.y_m, b).clip(0, len(grid.y_m) - 1)
    um = np.where(grid.known, grid.height_m, np.nan)[row, column] * 1e6
    if np.isfinite(um).any():
        um -= np.nanmedian(um)
    axis.set_facecolor("0.7")
    extent = (left * 1e3, right * 1e3, bottom * 1e3, top * 1e3)
    axis.imshow(um, origin="lower", cmap="RdBu_r", vmin=-300, vmax=300, extent=extent)
    for f in document["findings"]:
        outline = np.array([*f["outline_m"], f["outline_m"][0]])[:, :2] * 1e3
        axis.plot(*outline.T, "k-", lw=0.8)
        at = f["center_m"][0] * 1e3, f["center_m"][1] * 1e3
        axis.annotate(f"{f['depth_m'] * 1e6:+.0f}", at, fontsize=7, ha="center", va="center")
    axis.set_title(f"inspected: {document['verdict']}; µm, colours to ±300", fontsize=10)
    axis.set_xlabel("x, mm")


def _bounds(grid: HeightMap) -> list[float]:
    """Least x and y and most x and y of a map, m in base."""
    ends = np.array([[x, y] for x in grid.x_m[[0, -1]] for y in grid.y_m[[0, -1]]])
    places = ends @ grid.base_from_map[:2, :2].T + grid.base_from_map[:2, 3]
    return [*places.min(axis=0), *places.max(axis=0)]


def _draw_errors(axis: Axes, report: dict[str, Any]) -> None:
    truth = report["truth"]
    if not truth:
        spent = [w["milliseconds"]["total"] for w in report["windows"] if w["milliseconds"]]
        axis.set_title("time by window", fontsize=10)
        axis.plot(spent, ".-")
        axis.set_xlabel("window")
        axis.set_ylabel("ms")
        axis.set_ylim(bottom=0)
        return
    found = {k: f for k, f in truth["objects"].items() if f["points"]}
    found["all"] = truth["all"]
    names = [k for k, f in found.items() if f["points"]]
    values = [found[k]["mae_um"] for k in names]
    bars = axis.barh(names, values, color=["tab:blue"] * (len(names) - 1) + ["tab:gray"])
    labels = [f"{found[k]['mae_um']:.0f} µm" for k in names]
    for n, k in enumerate(names):
        if found[k]["edges_measured"] is not None:  # flat ones have none
            labels[n] += f", {found[k]['edges_measured']:.0%} of edges"
    axis.bar_label(bars, labels, fontsize=8, padding=2)
    axis.set_xlim(0, max([*values, 1.0]) * 1.7)
    axis.invert_yaxis()
    axis.set_title("mean absolute error against truth", fontsize=10)
    axis.set_xlabel("µm")


def _draw_text(axis: Axes, report: dict[str, Any]) -> None:
    axis.set_axis_off()
    lines = report["totals"]["braille_text"]
    read = " / ".join(lines) if lines else "–"
    text = f"text read:  {read}"
    if report["truth"] and report["truth"]["text"]:
        text += f"\ntext given: {report['truth']['text']}".replace("\n ", " / ")
    axis.text(0.0, 0.9, text, family="monospace", va="top", fontsize=12)
