"""Results of the Braille experiment as tables and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from .pictures import write_picture
from .rows import where
from .tables import Table

_HEAD = (
    "characters", "right", "CER", "WER", "unreadable", "misread", "missed",
    "ms a batch", "95 %", "ms/20 000 ev.",
)  # fmt: skip


def tables(result: dict[str, Any]) -> list[Table]:
    """All tables of a result."""
    rows = [
        (
            f"{r['condition']}, {r['method']}",
            f"{r['speed']:g}",
            f"{r['dot_contrast']:.2f}/{r['threshold']:.2f}",
            *_cells(r),
        )
        for r in result["rows"]
    ]
    note = " ".join(
        [
            "CER, WER: character and word error rate. misread: characters given as readable that "
            "aren't there; unreadable ones are marked so in the text. contrast: change of log "
            "intensity by a dot, and that which an event needs.",
            *too_faint(result),
        ]
    )
    head = ("condition, events", "m/s", "contrast", *_HEAD)
    out = [Table("Braille read, virtual cell", head, rows, note)]
    faults = [(_fault(r), f"{r['speed']:g}", *_cells(r)) for r in result["faults"]]
    if faults:
        out.append(Table("Wrong speed or depth", ("error", "m/s", *_HEAD), faults))
    published = [
        (
            p["name"],
            f"{p['speed']:g}" if p["speed"] else "–",
            f"{p['accuracy']:.1%}",
            f"{p['ms']:g}" if "ms" in p else "–",
        )
        for p in result["published"]
    ]
    out.append(
        Table(
            "Published readers",
            ("", "m/s", "characters right", "ms a batch"),
            published,
            "Real sensors, each on plates of its own: beside the figures above, not below them.",
        )
    )
    return out


def too_faint(result: dict[str, Any]) -> list[str]:
    """A sentence for each condition in which a dot isn't enough for an event."""
    faint = {r["condition"]: r for r in result["rows"] if r["dot_contrast"] < r["threshold"]}
    return [
        f"{name}: a dot changes log intensity by {r['dot_contrast']:.2f}, less than the threshold "
        f"of {r['threshold']:.2f}, so few pixels give any."
        for name, r in faint.items()
    ]


def _fault(r: dict[str, Any]) -> str:
    return f"{r['fault']}{', refined' if r['refined'] else ', not refined'}"


def _cells(r: dict[str, Any]) -> tuple[str, ...]:
    return (
        f"{r['characters']}",
        f"{r['character_accuracy']:.1%}",
        f"{r['character_error_rate']:.1%}",
        f"{r['word_error_rate']:.1%}",
        f"{r['unreadable']}",
        f"{r['misread']}",
        f"{r['missed']}",
        f"{r['ms_mean']:.1f}",
        f"{r['ms_p95']:.1f}",
        f"{r['ms_20000_events']:.1f}",
    )


#: A line and a marker by method: where results coincide, the later one is a ring around the first.
_STYLES = (("-", "o", 5), ("--", "o", 10))
_PER_CENT, _MS = (0, 1, 2, 5, 10, 20, 50, 100), (1, 2, 5, 10, 20, 50, 100)


def draw(result: dict[str, Any], path: Path) -> None:
    """Draw character error rates and times by speed, beside what others published."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 6), dpi=80, layout="constrained")
    _series(left, result, "character_error_rate", 100.0)
    _series(right, result, "ms_20000_events", 1.0)
    for p, marker in zip((p for p in result["published"] if p["speed"]), "*PXD", strict=False):
        left.plot(
            p["speed"], 100 * (1 - p["accuracy"]), marker, ms=11, color="gold", mec="black",
            label=p["name"], zorder=4, ls="none",
        )  # fmt: skip
        if "ms" in p:
            right.axhline(p["ms"], color="goldenrod", ls="--", label=f"{p['name']}, its laptop")
    left.set_ylabel("character error rate, %")
    left.set_yscale("symlog", linthresh=1.0)
    left.set_yticks(_PER_CENT, [f"{v}" for v in _PER_CENT])
    right.set_ylabel("ms for 20 000 events; few events cost more each")
    right.set_yscale("log")
    right.set_yticks(_MS, [f"{v}" for v in _MS])
    for axis in (left, right):
        axis.minorticks_off()
        axis.set_xlim(left=0.0)
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, fontsize=8)
    title = "Braille on the virtual cell, beside what others published of real sensors"
    figure.suptitle("\n".join([title, *too_faint(result)]), fontsize=11)
    write_picture(figure, path)


def _series(axis: Axes, result: dict[str, Any], column: str, factor: float) -> None:
    for k, condition in enumerate(result["options"]["conditions"]):
        methods = result["options"]["methods"]
        for (style, marker, size), method in zip(_STYLES, methods, strict=False):
            rows = where(result["rows"], condition=condition, method=method)
            axis.plot(
                [r["speed"] for r in rows], [factor * r[column] for r in rows], style,
                color=f"C{k}", marker=marker, ms=size, mfc="none" if size > 5 else f"C{k}",
                label=f"{condition}, {method}",
            )  # fmt: skip
    axis.set_xlabel("speed, m/s")
    axis.grid(True, alpha=0.3)
