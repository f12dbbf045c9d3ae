"""Figures of a benchmark."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any, Literal

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from matplotlib.transforms import Bbox

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
    "edge_drift": "v",
}
#: How far above or below its point a name may stand.
_SHIFTS = (0, 13, -13, 26, -26, 39, -39, 52, -52, 65, -65, 78, -78)
_SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")
#: Factors whose points are named, and what the legend says of factors.
_NAMED = ("base", "savings")
_FACTOR_NAMES = {
    "base": "base configuration",
    "savings": "without the savings",
    "edge_drift": "no edge drift correction",
}


def draw_speed_vs_error(result: dict[str, Any], path: Path) -> None:
    """Draw error against time, with the Pareto fronts and the paper's point.

    Parameters
    ----------
    result : dict
        Of `run_bench`.
    path : path
        PNG file.
    """
    figure, _, _ = speed_vs_error(result)
    figure.savefig(path)
    plt.close(figure)


def speed_vs_error(result: dict[str, Any]) -> tuple[Any, Axes, Axes]:
    """The figure of `draw_speed_vs_error`, not yet saved, and its two parts.

    The first is by time a window, for what makes depth maps; the second by time for a million
    events, which also tells where windows are of different lengths or there are none.
    """
    figure, (left, right) = plt.subplots(
        1, 2, sharey=True, figsize=(16, 8.5), dpi=110, layout="constrained"
    )
    speed = result["options"]["speeds"][0]
    rows = [
        r
        for r in result["cases"]
        if r["speed"] == speed and r["time"]["ms"] and r["error"]["near_edge_mae_um"]
    ]
    maps = [r for r in rows if r["method"] != "surface"]
    _draw_points(left, maps, "ms")
    _draw_points(right, rows, "ms_per_mev")
    paper = result["paper"]
    left.plot(paper["ms"], paper["error_um"], "*", ms=17, color="gold", mec="black", zorder=5)
    left.annotate(
        f"{paper['label']}\n(its laptop, real scans)", (paper["ms"], paper["error_um"]),
        xytext=(0, -11), textcoords="offset points", va="top", ha="center", fontsize=9, zorder=6,
    )  # fmt: skip
    for axis, shown, time in ((left, maps, "ms"), (right, rows, "ms_per_mev")):
        _draw_front(axis, shown, result["pareto"][time], time)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.grid(True, which="both", alpha=0.25)
    _make_room(left, right)
    _legends(left, rows)
    left.set_xlabel("ms a window")
    right.set_xlabel("ms for a million events")
    left.set_ylabel("mean absolute error near relief edges, µm (mean of the objects)")
    objects = len(result["options"]["objects"])
    figure.suptitle(
        f"Speed against error: {objects} object{'s' if objects != 1 else ''} at {speed:g} m/s "
        "(medians; bars: spread of the repeats)"
    )
    for axis in (left, right):
        _plain_ticks(axis)
    # Names need the final places of the points.
    figure.canvas.draw()
    _name_points(left, maps, set(result["pareto"]["ms"]), "ms")
    _name_points(right, rows, set(result["pareto"]["ms_per_mev"]), "ms_per_mev")
    return figure, left, right


def _draw_points(axis: Axes, rows: list[dict[str, Any]], time: str) -> None:
    for r in rows:
        t, error = r["time"], r["error"]["near_edge_mae_um"]
        base = r["factor"] == "base"
        axis.errorbar(
            t[time], error, xerr=[[t[time] - t[f"{time}_low"]], [t[f"{time}_high"] - t[time]]],
            fmt=_MARKERS[r["factor"]], ms=11 if base else 7, color=_COLOURS[r["method"]],
            mec="black", mew=1.2 if base else 0.4, elinewidth=0.8, alpha=1.0 if base else 0.75,
            zorder=4 if base else 3,
        )  # fmt: skip


def _make_room(*axes: Axes) -> None:
    """Room for the names, which stand beside their points."""
    for axis in axes:
        low, high = axis.get_xlim()
        axis.set_xlim(low / (high / low) ** 0.05, high * (high / low) ** 0.15)
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low / (high / low) ** 0.08, high * (high / low) ** 0.08)


def _draw_front(axis: Axes, rows: list[dict[str, Any]], labels: list[str], time: str) -> None:
    by_label = {r["label"]: r for r in rows}
    front = [by_label[name] for name in labels if name in by_label]
    x = [r["time"][time] for r in front]
    y = [r["error"]["near_edge_mae_um"] for r in front]
    axis.step(x, y, where="post", color="black", lw=1.2, ls="--", zorder=2, label="_front")
    axis.plot(x, y, "o", ms=16, mfc="none", mec="black", mew=1.0, zorder=2)


def _name_points(axis: Axes, rows: list[dict[str, Any]], front: set[str], time: str) -> None:
    """Names of base configurations and of the front; the others are told by their markers."""
    named = [r for r in rows if r["factor"] in _NAMED or r["label"] in front]
    canvas: Any = axis.figure.canvas
    renderer = canvas.get_renderer()
    markers = [axis.transData.transform((r["time"][time], _error(r))) for r in rows]
    taken = [Bbox.from_bounds(x - 8, y - 8, 16, 16) for x, y in markers]
    taken += [text.get_window_extent(renderer) for text in axis.texts]
    inside = axis.get_window_extent(renderer)
    for r in sorted(named, key=_error):
        edges = r["error"]["edges_measured"]
        share = f" ({edges:.0%} of edges)" if edges is not None else ""
        text = axis.annotate(
            f"{r['label']}{share}", (r["time"][time], _error(r)), xytext=(0, 0),
            textcoords="offset points", fontsize=8, zorder=6, va="center",
            arrowprops={"arrowstyle": "-", "lw": 0.5, "color": "gray", "shrinkA": 0},
            bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 0.5},
        )  # fmt: skip
        best = None
        # Near its point, right or left, above or below, where it lies on nothing else.
        for distance, ha in itertools.product(_SHIFTS, _SIDES):
            text.set_horizontalalignment(ha)
            text.set_position((12 if ha == "left" else -12, distance))
            box = _text_box(text, renderer)
            hidden = sum(box.overlaps(other) for other in taken)
            out = not (inside.x0 < box.x0 and box.x1 < inside.x1)
            out |= not (inside.y0 < box.y0 and box.y1 < inside.y1)
            cost = hidden + 100 * out
            if best is None or cost < best[0]:
                best = (cost, ha, text.get_position(), box)
            if cost == 0:
                break
        if best is not None:
            text.set_horizontalalignment(best[1])
            text.set_position(best[2])
            taken.append(best[3])


def _text_box(text: Any, renderer: Any) -> Bbox:
    """Where an annotation's text lies, without its line."""
    text.update_positions(renderer)
    return Text.get_window_extent(text, renderer)


def _error(row: dict[str, Any]) -> float:
    return float(row["error"]["near_edge_mae_um"])


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
    axis.figure.legend(handles=handles, fontsize=9, loc="outside lower center", ncols=7)


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
        # Cost grows to the right, so this corner is free.
        axis.legend(fontsize=8, loc="lower left" if quantity == "threads" else "upper left")
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
