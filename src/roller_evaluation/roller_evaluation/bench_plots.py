"""Pictures of a benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from .pictures import write_picture
from .rows import Row, values, where

COLOURS = {
    "focus": "tab:blue",
    "surface": "tab:green",
    "bma": "tab:red",
    "left_right": "tab:orange",
    "emvs": "tab:brown",
}
#: Where a name may stand: its side towards the point, and its offset, points.
_BESIDE = [("left", 10, y) for y in (6, -6, 16, -16)] + [
    (side, x, y)
    for y in (6, -6, 16, -16, 26, -26)
    for side, x in (("right", -10), ("left", 10), ("center", 0))
]
_MARKERS = {"base": "o", "planes": "^", "window": "s", "packet": "D"}


def draw_speed_vs_error(result: dict[str, Any], path: Path) -> None:
    """Draw error against time, with the Pareto fronts and the paper's point.

    Parameters
    ----------
    result : dict
        Of `write_bench`, or as much of it: cases, Pareto fronts, speeds, objects, paper.
    path : path
        PNG file.
    """
    write_picture(speed_vs_error(result)[0], path)


def speed_vs_error(result: dict[str, Any]) -> tuple[Figure, Axes, Axes]:
    """The picture of `draw_speed_vs_error`, not yet saved, and its two parts.

    The first is by time a window, for what makes depth maps; the second by time for a million
    events, which also holds where windows are of different lengths or there are none.
    """
    figure, (left, right) = plt.subplots(
        1, 2, sharey=True, figsize=(13, 6.5), dpi=80, layout="constrained"
    )
    speed = result["options"]["speeds"][0]
    cases = [
        c
        for c in result["cases"]
        if c["speed"] == speed and c["time"]["ms"] and c["error"]["near_edge_mae_um"]
        if c["factor"] != "coating"
    ]
    windows = [c for c in cases if c["method"] != "surface"]
    for axis, shown, time in ((left, windows, "ms"), (right, cases, "ms_per_mev")):
        _draw_cases(axis, shown, time)
        _draw_front(axis, shown, result["pareto"][time], time)
        axis.set(xscale="log", yscale="log")
        axis.grid(True, which="both", alpha=0.25)
    paper = result["paper"]
    left.plot(paper["ms"], paper["error_um"], "*", ms=17, color="gold", mec="black", zorder=5)
    left.annotate(
        f"{paper['label']}\n(its laptop, real scans)", (paper["ms"], paper["error_um"]),
        xytext=(0, -11), textcoords="offset points", va="top", ha="center", fontsize=9,
    )  # fmt: skip
    left.set(xlabel="ms a window", ylabel="mean absolute error near relief edges, µm")
    right.set(xlabel="ms for a million events")
    for axis in (left, right):
        axis.margins(x=0.15, y=0.1)
        _plain_ticks(axis)
    _legend(figure, cases)
    figure.draw_without_rendering()  # names go where things lie
    for axis, shown, time in ((left, windows, "ms"), (right, cases, "ms_per_mev")):
        _name_cases(axis, shown, time)
    count = len(result["options"]["objects"])
    figure.suptitle(
        f"Speed against error: mean of {count} object{'s' if count != 1 else ''} at {speed:g} m/s, "
        "with the share of relief edges measured"
    )
    return figure, left, right


def _draw_cases(axis: Axes, cases: Sequence[dict[str, Any]], time: str) -> None:
    for c in cases:
        t, error, base = c["time"], c["error"]["near_edge_mae_um"], c["factor"] == "base"
        axis.errorbar(
            t[time], error, xerr=[[t[time] - t[f"{time}_low"]], [t[f"{time}_high"] - t[time]]],
            fmt=_MARKERS[c["factor"]], ms=11 if base else 7, color=COLOURS[c["method"]],
            mec="black", mew=1.2 if base else 0.4, elinewidth=0.8, zorder=4 if base else 3,
        )  # fmt: skip


def _name_cases(axis: Axes, cases: Sequence[dict[str, Any]], time: str) -> None:
    """Name the base cases, each where its name covers nothing and stays in the picture."""
    points = [(c["time"][time], c["error"]["near_edge_mae_um"]) for c in cases]
    places = axis.transData.transform(points)
    taken = [text.get_window_extent() for text in axis.texts]
    taken += [Bbox.from_bounds(x - 6, y - 6, 12, 12) for x, y in places]
    frame = axis.get_window_extent()
    for c, point in zip(cases, points, strict=True):
        if c["factor"] == "base":
            edges = c["error"]["edges_measured"]
            name = c["method"] if edges is None else f"{c['method']} ({edges:.0%})"
            text = axis.annotate(name, point, xytext=(0, 0), textcoords="offset points",
                                 fontsize=9, zorder=6)  # fmt: skip
            for side, x, y in _BESIDE:
                text.set(ha=side, va="center")
                text.set_position((x, y))
                box = text.get_window_extent()
                inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and box.y1 <= frame.y1
                if inside and not any(box.overlaps(other) for other in taken):
                    break
            taken.append(box)


def _draw_front(
    axis: Axes, cases: Sequence[dict[str, Any]], labels: Sequence[str], time: str
) -> None:
    by_label = {c["label"]: c for c in cases}
    front = [by_label[name] for name in labels if name in by_label]
    x = [c["time"][time] for c in front]
    y = [c["error"]["near_edge_mae_um"] for c in front]
    axis.step(x, y, where="post", color="black", lw=1.2, ls="--", zorder=2)
    axis.plot(x, y, "o", ms=16, mfc="none", mec="black", mew=1.0, zorder=2)


def _legend(figure: Figure, cases: Sequence[dict[str, Any]]) -> None:
    def handle(label: str, **style: Any) -> Line2D:
        return Line2D([], [], label=label, **{"ls": "", "mec": "black", **style})

    methods = {c["method"] for c in cases}
    factors = {c["factor"] for c in cases}
    handles = [handle(m, marker="o", color=c) for m, c in COLOURS.items() if m in methods]
    handles += [
        handle("defaults" if f == "base" else f"another {f}", marker=m, color="lightgray")
        for f, m in _MARKERS.items()
        if f in factors
    ]
    handles.append(handle("Pareto front", marker="o", ms=12, mfc="none", ls="--", color="black"))
    figure.legend(handles=handles, fontsize=9, loc="outside lower center", ncols=6)


def draw_scaling(rows: Sequence[Row], path: Path) -> None:
    """Draw milliseconds a window against events, planes and threads."""
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.8), dpi=80, layout="constrained")
    for axis, quantity in zip(axes, ("events", "planes", "threads"), strict=True):
        grown = [r for r in where(rows, quantity=quantity) if r["ms"] is not None]
        for method in dict.fromkeys(r["method"] for r in grown):
            own = where(grown, method=method)
            x = list(dict.fromkeys(r["value"] for r in own))
            spent = [sorted(values(where(own, value=v), "ms")) for v in x]
            y = [each[len(each) // 2] for each in spent]
            spread = [[m - each[0] for m, each in zip(y, spent, strict=True)],
                      [each[-1] - m for m, each in zip(y, spent, strict=True)]]  # fmt: skip
            axis.errorbar(x, y, yerr=spread, fmt="o-", color=COLOURS[method], label=method)
        label = "events a window" if quantity == "events" else quantity
        axis.set(xlabel=label, xscale="log", yscale="log")
        axis.grid(True, which="both", alpha=0.25)
        _plain_ticks(axis)
        axis.legend(fontsize=8)
    axes[0].set_ylabel("ms a window")
    figure.suptitle("Cost as the work grows", fontsize=11)
    write_picture(figure, path)


def _plain_ticks(axis: Axes) -> None:
    """Numbers instead of powers of ten, at 1, 2 and 5."""
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        side.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        side.set_minor_formatter(NullFormatter())
