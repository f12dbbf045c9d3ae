"""The picture of a run: depth, cloud from above and in profile, error, text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from rosbags.rosbag2 import Reader

from roller_core.bags import typestore
from roller_driver.virtual.truth import Truth
from roller_emvs.ply import read_ply

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

F64 = npt.NDArray[np.float64]

_MOST_POINTS = 400_000
_DEPTH_MAP = "turbo_r"
_HEIGHT_MAP = "viridis"


def draw_overview(folder: Path, source: Path) -> Path:
    """Draw `overview.png` from the files of a run.

    Parameters
    ----------
    folder : path
        Output folder of a run, finished.
    source : path
        Its input; a simulated scan has its truth beside it.

    Returns
    -------
    path
        The picture.
    """
    report = json.loads((folder / "report.json").read_text())
    truth = None
    if source.is_dir() and (source / "truth.yaml").is_file():
        truth = Truth.load(source)
    cloud = _thinned(read_ply(folder / "surface.ply"))
    figure = plt.figure(figsize=(15, 11), dpi=100, layout="constrained")
    grid = figure.add_gridspec(4, 3, height_ratios=[1.25, 0.9, 0.8, 0.18])
    depth_axes = [figure.add_subplot(grid[0, k]) for k in range(3)]
    _draw_depths(figure, depth_axes, folder, report, truth)
    _draw_above(figure, figure.add_subplot(grid[1, :]), cloud)
    _draw_profile(figure.add_subplot(grid[2, :2]), cloud, truth)
    _draw_errors(figure.add_subplot(grid[2, 2]), report)
    _draw_text(figure.add_subplot(grid[3, :]), report)
    figure.suptitle(
        f"{source.name}: {report['totals']['depth_windows']} depth maps by {report['method']}, "
        f"{report['totals']['surface_points']} surface points"
    )
    path = folder / "overview.png"
    figure.savefig(path)
    plt.close(figure)
    return path


def _thinned(cloud: dict[str, F64]) -> dict[str, F64]:
    n = len(cloud["x"])
    if n <= _MOST_POINTS:
        return cloud
    chosen = np.random.default_rng(0).choice(n, _MOST_POINTS, replace=False)
    return {name: column[chosen] for name, column in cloud.items()}


def _draw_depths(
    figure: Figure, axes: list[Axes], folder: Path, report: dict[str, Any], truth: Truth | None
) -> None:
    """The depth maps with most points of three stretches of the run."""
    windows = [w for w in report["windows"] if w["points"]]
    parts = np.array_split(np.array([w["points"] for w in windows]), 3)
    chosen, first = [], 0
    for part in parts:
        if len(part):
            chosen.append(int(windows[first + int(np.argmax(part))]["stamp_ns"]))
        first += len(part)
    images = _depth_images(folder / "result", set(chosen))
    measured = [i[np.isfinite(i)].astype(np.float64) for i in images.values()]
    low, high = _limits(np.concatenate(measured) if measured else np.empty(0))
    picture = None
    for axis, stamp in zip(axes, chosen, strict=False):
        mm = images[stamp] * 1e3
        picture = axis.imshow(_thick(mm), cmap=_DEPTH_MAP, vmin=low * 1e3, vmax=high * 1e3)
        title = f"depth at {(stamp - chosen[0]) * 1e-9:+.3f} s"
        if truth is not None:
            error = _error_um(images[stamp], stamp, truth)
            if len(error):
                title += f", error {np.abs(error).mean():.0f} µm"
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("u, px")
    for axis in axes[len(chosen) :]:
        axis.set_axis_off()
    axes[0].set_ylabel("v, px")
    if picture is not None:
        figure.colorbar(picture, ax=axes, label="depth, mm", shrink=0.85)


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
        for connection, log_ns, data in reader.messages(wanted):
            if log_ns in stamps:
                message: Any = store.deserialize_cdr(data, connection.msgtype)
                pixels = np.frombuffer(message.data, np.float32)
                found[log_ns] = pixels.reshape(message.height, message.width)
    return found


def _error_um(depth: npt.NDArray[np.float32], stamp: int, truth: Truth) -> F64:
    v, u = np.nonzero(np.isfinite(depth))
    pixels = np.stack([u, v], axis=-1)
    contact = truth.contact_at(stamp, pixels)
    return np.asarray((depth[v, u] - truth.depth_at(stamp, pixels))[contact] * 1e6)


def _limits(values: F64) -> tuple[float, float]:
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, [0.5, 99.5])
    return float(low), float(max(high, low + 1e-6))


def _draw_above(figure: Figure, axis: Axes, cloud: dict[str, F64]) -> None:
    axis.set_title("surface from above", fontsize=10)
    if not len(cloud["x"]):
        axis.text(0.5, 0.5, "no surface points", ha="center", transform=axis.transAxes)
        return
    low, high = _limits(cloud["height"])
    order = np.argsort(cloud["height"])
    picture = axis.scatter(
        cloud["x"][order] * 1e3, cloud["y"][order] * 1e3, c=cloud["height"][order] * 1e3,
        s=0.4, cmap=_HEIGHT_MAP, vmin=low * 1e3, vmax=high * 1e3, linewidths=0, rasterized=True,
    )  # fmt: skip
    axis.set_aspect("equal")
    axis.set_xlabel("x, mm")
    axis.set_ylabel("y, mm")
    figure.colorbar(picture, ax=axis, label="height, mm", shrink=0.8)


def _draw_profile(axis: Axes, cloud: dict[str, F64], truth: Truth | None) -> None:
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
        height = truth.height_at(x, np.full_like(x, middle)) - truth.origin_m[2]
        axis.plot(x * 1e3, height * 1e3, "k-", lw=0.8, label="truth (skin)")
        axis.set_ylim(height.min() * 1e3 - 0.4, height.max() * 1e3 + 0.4)
    axis.legend(loc="upper right", fontsize=8, markerscale=6)


def _draw_errors(axis: Axes, report: dict[str, Any]) -> None:
    truth = report["truth"]
    if not truth:
        spent = [w["milliseconds"]["total"] for w in report["windows"] if w["milliseconds"]]
        axis.set_title("time by window (no truth known)", fontsize=10)
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
    labels = [
        f"{found[k]['mae_um']:.0f} µm, {(found[k]['edges_measured'] or 0):.0%} of edges"
        for k in names
    ]
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
