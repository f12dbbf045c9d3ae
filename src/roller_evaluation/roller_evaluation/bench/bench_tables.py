"""Results of a benchmark as Markdown and on the screen."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from roller_evaluation.tables import Table, show_tables, write_text

from .cases import SAVINGS_NOTE


def write_markdown(result: dict[str, Any], path: Path) -> None:
    """Write the tables.

    Raises
    ------
    UnwritableOutputError
        If it can't be written.
    """
    m = result["machine"]
    lines = ["# Speed against error", "", f"{m['processor']}, {m['cores']} cores.", ""]
    for table in tables(result):
        lines += [f"## {table.title}", "", "| " + " | ".join(table.head) + " |"]
        lines.append("|" + "---|" * len(table.head))
        lines += ["| " + " | ".join(row) + " |" for row in table.rows]
        lines += ["", table.note, ""] if table.note else [""]
    write_text(path, "\n".join(lines))


def print_tables(result: dict[str, Any]) -> None:
    """Print the tables of a benchmark."""
    show_tables(tables(result))


def tables(result: dict[str, Any]) -> list[Table]:
    """All tables of a result."""
    parts: list[Callable[[dict[str, Any]], Table | None]] = [
        _cases, _objects, _savings, _fixed, _growth, _slider,
    ]  # fmt: skip
    return [table for part in parts if (table := part(result)) is not None]


def _cases(result: dict[str, Any]) -> Table:
    marks = {"★": set(result["pareto"]["ms_per_mev"]), "☆": set(result["pareto"]["ms"])}
    base_speed = result["options"]["speeds"][0]
    rows = []
    for r in result["cases"]:
        t, e = r["time"], r["error"]
        at_base = r["speed"] == base_speed
        stars = "".join(m for m, front in marks.items() if at_base and r["label"] in front)
        rows.append(
            (
                f"{r['label']} {stars}".strip(), f"{r['speed']:g}", _number(t["ms"], 1),
                _spread(t), _number(t["ms_per_mev"], 0), _number(e["near_edge_mae_um"], 1),
                _number(e["mae_um"], 1), _number(e["median_um"], 1), _number(e["bias_um"], 1),
                _share(e["edges_measured"]),
            )
        )  # fmt: skip
    paper = result["paper"]
    rows.append(
        ("paper (laptop, real)", "-", _number(paper["ms"], 1), "-", "-", "-",
         _number(paper["error_um"], 0), "-", "-", "-")
    )  # fmt: skip
    head = (
        "case", "m/s", "ms/window", "spread", "ms/Mev", "near edges µm", "MAE µm", "median µm",
        "bias µm", "edges",
    )  # fmt: skip
    note = (
        "★ is on the Pareto front of time for a million events and error near edges, ☆ on that of "
        "time a window. Errors are means over the objects; spread is between the medians of the "
        "repeats. A window of surface is a block along the roll: compare it by ms/Mev. bma fuses "
        "three views and left_right two; focus, emvs and surface fuse none."
    )
    return Table("Cases", head, rows, note)


def _objects(result: dict[str, Any]) -> Table:
    names = result["options"]["objects"]
    rows = []
    for r in result["cases"]:
        if r["factor"] == "base":
            cells = [r["objects"][n] for n in names]
            texts = [
                f"{_number(c['near_edge_mae_um'], 0)} ({_share(c['edges_measured'])})"
                for c in cells
            ]
            rows.append((r["label"], *texts))
    note = "Mean absolute error near relief edges, µm, and the share of relief edges measured."
    return Table("Methods by object", ("method", *names), rows, note)


def _savings(result: dict[str, Any]) -> Table | None:
    if not result["savings"]:
        return None
    rows = []
    for r in result["savings"]:
        on, off = r["on"], r["off"]
        rows.append(
            (
                r["saving"], r["method"], _number(off["ms"], 1), _number(on["ms"], 1),
                _number(off["near_edge_mae_um"], 1), _number(on["near_edge_mae_um"], 1),
                _share(off["edges_measured"]), _share(on["edges_measured"]),
                f"{_number(r['times_faster'], 2)} ×",
            )
        )  # fmt: skip
    head = ("saving", "method", "ms off", "ms on", "µm off", "µm on", "edges off", "edges on",
            "faster")  # fmt: skip
    return Table("Savings, off and on", head, rows, SAVINGS_NOTE)


def _fixed(result: dict[str, Any]) -> Table | None:
    f = result["fixed"]
    if not f["windows"]:
        return None
    rows = []
    for name, r in [*f["methods"].items(), ("reference", f["reference"])]:
        ratio = f"{_number(r['ratio'], 1)} ×" if "ratio" in r else "1 ×"
        rows.append(
            (
                r.get("what", name), str(r["windows"]), _number(r["ms"], 1),
                _number(r.get("ms_p95"), 1), ratio, _number(r["error"]["mae_um"], 1),
                _number(r["error"]["near_edge_mae_um"], 1), _share(r["error"]["edges_measured"]),
            )
        )  # fmt: skip
    d = f["bma_from_reference"]
    note = (
        f"{', '.join(f['objects'])} at {f['speed']:g} m/s. bma is {_number(d['median_um'], 2)} µm "
        f"from the reference at the median and {_number(d['p95_um'], 2)} µm at the 95th percentile "
        f"where both measured; their masks' intersection over union is "
        f"{_number(d['mask_iou'], 3)}. Ratios and errors are over the reference's windows."
    )
    head = ("method", "windows", "ms median", "ms 95 %", "faster", "MAE µm", "near edges µm",
            "edges")  # fmt: skip
    title = f"Fixed case: {f['events']:,} events in {f['window_ms']:g} ms"
    return Table(title, head, rows, note)


def _growth(result: dict[str, Any]) -> Table:
    rows = []
    for quantity in ("events", "planes", "image", "threads"):
        for r in result["growth"][quantity]:
            value = r[quantity]
            text = "×".join(map(str, value)) if isinstance(value, list | tuple) else f"{value:,}"
            rows.append(
                (f"{quantity}: {text}", r["method"], _number(r["ms"], 1), _spread(r))
            )  # fmt: skip
    base = result["growth"]["base"]
    note = (
        f"One window of {base['window_ms']:g} ms of {base['object']} at {base['speed']:g} m/s, "
        f"{base['events']:,} events where they don't grow."
    )
    return Table("Cost as the work grows", ("quantity", "method", "ms", "spread"), rows, note)


def _slider(result: dict[str, Any]) -> Table | None:
    s = result["slider"]
    if s is None:
        return None
    rows = [
        (
            str(r["threads"]), _number(r["votes_mev_s"], 2), _number(r["depth_map_mev_s"], 2),
            _number(r["cpp_mev_s"], 2), f"{_number(r['ratio'], 2)} ×",
        )
        for r in s["threads"]
    ]  # fmt: skip
    head = ("threads", "votes Mev/s", "depth map Mev/s", "C++ votes Mev/s", "ratio")
    note = "The C++ figures were measured on another machine with two cores."
    return Table(f"slider_depth, {s['planes']} planes", head, rows, note)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"


def _spread(times: dict[str, Any]) -> str:
    if times["ms"] is None:
        return "-"
    return f"{times['ms_low']:.1f}–{times['ms_high']:.1f}"
