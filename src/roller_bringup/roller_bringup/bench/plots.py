"""Figures of a benchmark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

_COLOURS = {
    "focus": "tab:blue",
    "surface": "tab:green",
    "bma": "tab:red",
    "left_right": "tab:orange",
    "emvs": "tab:brown",
}
_MARKERS = {
    "base": "o",
    "savings": "X",
    "planes": "^",
    "window": "s",
    "packet": "D",
    "precision": "P",
    "tiles": "v",
}
#: Width of a name in the figure, about.
_NAME_PX = 200.0
_FACTOR_NAMES = {"base": "base configuration", "savings": "without the savings"}


def draw_speed_vs_error(result: dict[str, Any], path: Path) -> None:
    """Draw error against milliseconds a window, with the Pareto front and the paper's point.

    Parameters
    ----------
    result : dict
        Of `run_bench`.
    path : path
        PNG file.
    """
    figure, axis = speed_vs_error(result)
    del axis
    figure.savefig(path)
    plt.close(figure)


def speed_vs_error(result: dict[str, Any]) -> tuple[Any, Axes]:
    """The figure of `draw_speed_vs_error`, not yet saved."""
    figure, axis = plt.subplots(figsize=(12, 7), dpi=110, layout="constrained")
    speed = result["options"]["speeds"][0]
    rows = [
        r
        for r in result["cases"]
        if r["speed"] == speed and r["time"]["ms"] and r["error"]["near_edge_mae_um"]
    ]
    for r in rows:
        t, error = r["time"], r["error"]["near_edge_mae_um"]
        colour = _COLOURS.get(r["method"], "tab:gray")
        base = r["factor"] == "base"
        axis.errorbar(
            t["ms"], error, xerr=[[t["ms"] - t["ms_low"]], [t["ms_high"] - t["ms"]]],
            fmt=_MARKERS[r["factor"]], ms=11 if base else 6, color=colour,
            mec="black", mew=1.2 if base else 0.4, elinewidth=0.8, alpha=1.0 if base else 0.75,
            zorder=4 if base else 3,
        )  # fmt: skip
    _draw_front(axis, rows, result["pareto"])
    paper = result["paper"]
    axis.plot(paper["ms"], paper["error_um"], "*", ms=17, color="gold", mec="black", zorder=5)
    axis.annotate(
        f"{paper['label']}\n(its laptop, real scans)", (paper["ms"], paper["error_um"]),
        xytext=(10, -4), textcoords="offset points", va="top", fontsize=9, zorder=6,
    )  # fmt: skip
    axis.set_xscale("log")
    axis.set_yscale("log")
    _make_room(axis)
    _plain_ticks(axis)
    _name_points(axis, rows, set(result["pareto"]))
    axis.set_xlabel("ms a window (median; bars: spread of the repeats)")
    axis.set_ylabel("mean absolute error near relief edges, µm (mean of the objects)")
    objects = len(result["options"]["objects"])
    title = f"Speed against error: {objects} object{'s' if objects != 1 else ''} at {speed:g} m/s"
    axis.set_title(title)
    axis.grid(True, which="both", alpha=0.25)
    _legends(axis, rows)
    return figure, axis


def _make_room(axis: Axes) -> None:
    """Room for the names, which stand beside their points."""
    low, high = axis.get_xlim()
    axis.set_xlim(low / 1.1, high * (high / low) ** 0.1)
    low, high = axis.get_ylim()
    axis.set_ylim(low / 1.15, high * 1.1)


def _draw_front(axis: Axes, rows: list[dict[str, Any]], labels: list[str]) -> None:
    by_label = {r["label"]: r for r in rows}
    front = [by_label[name] for name in labels if name in by_label]
    x = [r["time"]["ms"] for r in front]
    y = [r["error"]["near_edge_mae_um"] for r in front]
    axis.step(x, y, where="post", color="black", lw=1.2, ls="--", zorder=2, label="_front")
    axis.plot(x, y, "o", ms=15, mfc="none", mec="black", mew=1.0, zorder=2)


def _name_points(axis: Axes, rows: list[dict[str, Any]], front: set[str]) -> None:
    """Names of base configurations and of the front; the others are told by their markers."""
    named = [r for r in rows if r["factor"] in _FACTOR_NAMES or r["label"] in front]
    placed: list[tuple[float, float]] = []
    pixels = axis.figure.dpi / 72
    for r in sorted(named, key=lambda r: float(r["error"]["near_edge_mae_um"])):
        point = (float(r["time"]["ms"]), float(r["error"]["near_edge_mae_um"]))
        x, y = (float(v) for v in axis.transData.transform(point))
        # Names of points on the right stand to their left.
        left = axis.transAxes.inverted().transform((x, y))[0] > 0.7
        end = x - _NAME_PX if left else x
        shift = 5.0
        # A name that would lie on another one goes further up.
        while any(abs(end - a) < _NAME_PX and abs(y + shift - b) < 17 for a, b in placed):
            shift += 17.0
        placed.append((end, y + shift))
        edges = r["error"]["edges_measured"]
        share = f" ({edges:.0%} of edges)" if edges is not None else ""
        axis.annotate(
            f"{r['label']}{share}", point, xytext=(-9 if left else 9, shift / pixels),
            textcoords="offset points", ha="right" if left else "left", fontsize=8, zorder=2.5,
            bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 0.5},
        )  # fmt: skip


def _legends(axis: Axes, rows: list[dict[str, Any]]) -> None:
    methods = [m for m in _COLOURS if any(r["method"] == m for r in rows)]
    factors = [f for f in _MARKERS if any(r["factor"] == f for r in rows)]
    handles = [
        Line2D([], [], marker="o", ls="", color=_COLOURS[m], mec="black", label=m) for m in methods
    ]
    handles += [
        Line2D([], [], marker=_MARKERS[f], ls="", color="lightgray", mec="black",
               label=_FACTOR_NAMES.get(f, f"{f} varied"))
        for f in factors
    ]  # fmt: skip
    handles.append(
        Line2D([], [], marker="o", ms=12, mfc="none", mec="black", ls="--", color="black",
               label="Pareto front")
    )  # fmt: skip
    axis.figure.legend(handles=handles, fontsize=8, loc="outside right upper")


def draw_growth(result: dict[str, Any], path: Path) -> None:
    """Draw milliseconds a window against events, planes, pixels and threads.

    Parameters
    ----------
    result : dict
        Of `run_bench`.
    path : path
        PNG file.
    """
    growth = result["growth"]
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.8), dpi=110, layout="constrained")
    names = {"events": "events a window", "planes": "planes", "image": "pixels"}
    for axis, quantity in zip(axes, ("events", "planes", "image", "threads"), strict=True):
        rows = [r for r in growth[quantity] if r["ms"] is not None]
        for method in dict.fromkeys(r["method"] for r in rows):
            mine = [r for r in rows if r["method"] == method]
            x = [_size(r[quantity]) for r in mine]
            y = [r["ms"] for r in mine]
            spread = [
                [r["ms"] - r["ms_low"] for r in mine],
                [r["ms_high"] - r["ms"] for r in mine],
            ]
            axis.errorbar(x, y, yerr=spread, fmt="o-", color=_COLOURS[method], label=method)
        axis.set_xlabel(names.get(quantity, quantity))
        axis.grid(True, which="both", alpha=0.25)
        if quantity == "threads":
            axis.set_xticks(sorted({_size(r[quantity]) for r in rows}))
            axis.set_ylim(bottom=0)
        else:
            axis.set_xscale("log")
            axis.set_yscale("log")
            _plain_ticks(axis)
            texts = {_size(r[quantity]): _text(r[quantity]) for r in rows}
            axis.set_xticks(sorted(texts), [texts[size] for size in sorted(texts)], fontsize=8)
            axis.xaxis.set_minor_locator(NullLocator())
        axis.legend(fontsize=8)
    axes[0].set_ylabel("ms a window")
    base = growth["base"]
    figure.suptitle(
        f"Cost as the work grows: {base['events']:,} events of {base['object']} in "
        f"{base['window_ms']:g} ms, {base['image'][0]}×{base['image'][1]} px",
        fontsize=11,
    )
    figure.savefig(path)
    plt.close(figure)


def _size(value: Any) -> float:
    """Pixels of an image size, or the number itself."""
    return float(value[0] * value[1]) if isinstance(value, list | tuple) else float(value)


def _text(value: Any) -> str:
    """An image size, or a number with k and M for thousands and millions."""
    if isinstance(value, list | tuple):
        return f"{value[0]}×\n{value[1]}"
    for size, letter in ((1_000_000, "M"), (1000, "k")):
        if value >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


def _plain_ticks(axis: Axes) -> None:
    """Numbers instead of powers of ten, at 1, 2 and 5."""
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        side.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        side.set_minor_formatter(NullFormatter())
