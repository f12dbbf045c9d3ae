"""Figure of the Braille experiment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from .braille_tables import too_faint
from .pictures import write_picture

_COLOURS = (
    "tab:blue", "tab:orange", "tab:red", "tab:green", "tab:purple", "tab:brown", "tab:cyan",
    "tab:olive",
)  # fmt: skip
#: A line and a marker by method: where results coincide, the later one is a ring around the first.
_STYLES = (("-", "o", 5), ("--", "o", 10), (":", "s", 13), ("-.", "D", 16))
_MS_TICKS = (1, 2, 5, 10, 20, 50, 100)


def draw(result: dict[str, Any], path: Path) -> None:
    """Draw errors by speed, what became of characters under wrong speeds and depths, and times.

    Parameters
    ----------
    result : dict
        Of `run_braille`.
    path : path
        PNG file.

    Raises
    ------
    UnwritableOutputError
        If it can't be written.
    """
    figure, axes = plt.subplots(1, 3, figsize=(16, 6.2), dpi=100, layout="constrained")
    _draw_errors(axes[0], result)
    _draw_faults(axes[1], result)
    _draw_times(axes[2], result)
    title = "Braille on the virtual cell, beside what others published of real sensors"
    figure.suptitle("\n".join([title, *too_faint(result)]), fontsize=11)
    write_picture(figure, path)


def _series(axis: Axes, result: dict[str, Any], value: str, factor: float) -> None:
    conditions, methods = result["options"]["conditions"], result["options"]["methods"]
    for colour, condition in zip(_COLOURS, conditions, strict=False):
        for (style, marker, size), method in zip(_STYLES, methods, strict=False):
            rows = [
                r for r in result["rows"] if (r["condition"], r["method"]) == (condition, method)
            ]
            axis.plot(
                [r["speed"] for r in rows], [factor * r[value] for r in rows],
                style, color=colour, marker=marker, ms=size,
                mfc="none" if size > 5 else colour, label=f"{condition}, {method}",
            )  # fmt: skip
    axis.set_xlabel("speed, m/s")
    axis.grid(True, alpha=0.3)


def _draw_errors(axis: Axes, result: dict[str, Any]) -> None:
    _series(axis, result, "character_error_rate", 100.0)
    known = [p for p in result["published"] if p["speed"]]
    for p, marker in zip(known, "*PXD", strict=False):
        axis.plot(
            p["speed"], 100 * (1 - p["accuracy"]), marker, ms=11, color="gold", mec="black",
            label=p["name"], zorder=4, ls="none",
        )  # fmt: skip
    axis.set_ylabel("character error rate, %")
    axis.set_yscale("symlog", linthresh=1.0)
    top = max([100.0 * r["character_error_rate"] for r in result["rows"]] + [15.0])
    axis.set_ylim(-0.1, 1.3 * top)
    axis.set_yticks([t for t in (0, 1, 2, 5, 10, 20, 50, 100) if t <= 1.3 * top])
    axis.get_yaxis().set_major_formatter("{x:g}")
    axis.minorticks_off()
    axis.set_xlim(left=0.0)
    _legend_below(axis)


def _draw_faults(axis: Axes, result: dict[str, Any]) -> None:
    rows = result["faults"]
    left = [0.0] * len(rows)
    names = [f"{r['fault']}{'' if r['refined'] else ', not refined'}" for r in rows]
    parts = (
        ("right", "tab:green"), ("unreadable", "silver"), ("missed", "dimgrey"),
        ("wrong", "tab:red"),
        ("extra", "tab:purple"),
    )  # fmt: skip
    for part, colour in parts:
        share = [100.0 * r[part] / max(r["characters"], 1) for r in rows]
        axis.barh(names, share, left=left, color=colour, label=part, height=0.6)
        left = [a + b for a, b in zip(left, share, strict=True)]
    axis.invert_yaxis()
    axis.set_xlabel("characters, % of those there")
    speed = f" at {rows[0]['speed']:g} m/s" if rows else ""
    axis.set_title(f"wrong speed or depth{speed}", fontsize=10)
    _legend_below(axis, columns=5)


def _draw_times(axis: Axes, result: dict[str, Any]) -> None:
    _series(axis, result, "ms_20000_events", 1.0)
    for p in result["published"]:
        if "ms" in p:
            axis.axhline(p["ms"], color="goldenrod", ls="--", label=f"{p['name']}, its laptop")
    axis.set_ylabel("ms for 20 000 events; few events cost more each")
    axis.set_yscale("log")
    axis.set_yticks(_MS_TICKS, [f"{ms:g}" for ms in _MS_TICKS])
    axis.minorticks_off()
    axis.set_xlim(left=0.0)
    _legend_below(axis)


def _legend_below(axis: Axes, columns: int = 2) -> None:
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=columns, fontsize=8)
