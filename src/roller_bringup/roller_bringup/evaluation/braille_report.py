"""Results of the Braille experiment as JSON and as tables."""

from __future__ import annotations

from typing import Any

from roller_bringup.results.tables import Table

_HEAD = (
    "characters", "right", "CER", "WER", "unreadable", "misread", "missed",
    "ms a frame", "95 %", "ms/20 000 ev.",
)  # fmt: skip


def tables(result: dict[str, Any]) -> list[Table]:
    """All tables of a result."""
    rows = [
        (f"{r['condition']}, {r['method']}", f"{r['speed']:g}", *_cells(r)) for r in result["rows"]
    ]
    note = (
        "CER, WER: character and word error rate. misread: characters given as readable that "
        "aren't there; unreadable ones are marked so in the text."
    )
    out = [Table("Braille read, virtual cell", ("condition, events", "m/s", *_HEAD), rows, note)]
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
            ("", "m/s", "characters right", "ms a frame"),
            published,
            "Real sensors, each on plates of its own: beside the figures above, not below them.",
        )
    )
    return out


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
