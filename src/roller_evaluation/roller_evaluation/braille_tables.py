"""Results of the Braille experiment as JSON and as tables."""

from __future__ import annotations

from typing import Any

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
