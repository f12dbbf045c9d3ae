"""Tables of a benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .fixed_window import REFERENCE
from .measures import STAGES
from .rows import Row, mean, values, where
from .tables import Table, number, share


def tables(result: dict[str, Any]) -> list[Table]:
    """All tables of a result of `write_bench`."""
    found = [_cases(result), _stages(result), _objects(result)]
    found += [_fixed(result["fixed"])] if result["fixed"] else []
    found += [_scaling(result["growth"])] if result["growth"] else []
    return found


def _cases(result: dict[str, Any]) -> Table:
    marks = {"★": set(result["pareto"]["ms_per_mev"]), "☆": set(result["pareto"]["ms"])}
    base_speed, objects = result["options"]["speeds"][0], result["options"]["objects"]
    rows = []
    for c in result["cases"]:
        t, e = c["time"], c["error"]
        at_base = c["speed"] == base_speed
        stars = "".join(m for m, front in marks.items() if at_base and c["label"] in front)
        # Of an interrupted run, which the front leaves out.
        part = "" if len(c["objects"]) == len(objects) else f"{len(c['objects'])} objects"
        label = " ".join(f"{c['label']} {stars} {part}".split())
        rows.append(
            (
                label, f"{c['speed']:g}", number(t["ms"], 1),
                _spread(t["ms_low"], t["ms_high"]), number(t["ms_per_mev"], 0),
                number(t["cpu_ms_per_mev"], 0), number(e["near_edge_mae_um"], 1),
                number(e["mae_um"], 1), number(e["bias_um"], 1), share(e["edges_measured"]),
            )
        )  # fmt: skip
    paper = result["paper"]
    rows.append(
        ("paper (laptop, real)", "–", number(paper["ms"], 1), "–", "–", "–", "–",
         number(paper["error_um"], 0), "–", "–")
    )  # fmt: skip
    head = (
        "case", "m/s", "ms/window", "spread", "ms/Mev", "CPU ms/Mev", "near edges µm", "MAE µm",
        "bias µm", "edges",
    )  # fmt: skip
    note = (
        "★ is on the Pareto front of time for a million events and error near edges, ☆ on that of "
        "time a window. Times are means over the objects of each one's median window, errors means "
        "over the objects; spread is that of the repeats. A window of surface is a block along the "
        "roll: compare it by ms/Mev. bma fuses three views, left_right two, the others none. "
        "Printed: the printed coating, a whole pass."
    )
    return Table("Cases", head, rows, note)


def _stages(result: dict[str, Any]) -> Table:
    cases = [c for c in result["cases"] if c["factor"] in ("base", "speed", "coating")]
    names = [stage for stage in STAGES if any(stage in c["stages"] for c in cases)]
    rows = [
        (
            c["label"], f"{c['speed']:g}", *(number(c["stages"].get(s), 1) for s in names),
            number(sum(c["stages"].values()), 1),
        )
        for c in cases
    ]  # fmt: skip
    note = (
        "Mean over objects and runs; all threads. Before all of them, decoding packets and mapping "
        f"their times takes {number(result['decoding_cpu_ns'], 1)} ns an event (libcaer_cmp)."
    )
    return Table("CPU ns an event by stage", ("method", "m/s", *names, "sum"), rows, note)


def _objects(result: dict[str, Any]) -> Table:
    names = result["options"]["objects"]
    rows = []
    for c in result["cases"]:
        if c["factor"] == "base":
            texts = [
                f"{number(e['near_edge_mae_um'], 0)} ({share(e['edges_measured'])})" if e else "–"
                for e in map(c["objects"].get, names)
            ]
            rows.append((c["label"], *texts))
    note = "Mean absolute error near relief edges, µm, and the share of relief edges measured."
    return Table("Methods by object", ("method", *names), rows, note)


def _fixed(rows: Sequence[Row]) -> Table:
    cells = []
    for method in dict.fromkeys(r["method"] for r in rows):
        own = where(rows, method=method)
        cells.append(
            (
                method, f"{sum(values(own, 'windows')):.0f}", number(mean(own, "ms"), 1),
                number(mean(own, "cpu_ms"), 1), f"{number(mean(own, 'faster'), 1)} ×",
                number(mean(own, "mae_um"), 1), number(mean(own, "near_edge_mae_um"), 1),
                share(mean(own, "edges_measured")),
            )
        )  # fmt: skip
    bma = where(rows, method="bma")
    names = ", ".join(dict.fromkeys(r["object"] for r in rows))
    note = (
        f"{names} at {rows[0]['speed']:g} m/s. bma is {number(mean(bma, 'apart_median_um'), 2)} µm "
        f"from {REFERENCE} at the median and {number(mean(bma, 'apart_p95_um'), 2)} µm at the 95th "
        "percentile where both measured; their masks' intersection over union is "
        f"{number(mean(bma, 'mask_iou'), 3)}. Ratios and errors are over the reference's windows."
    )
    head = ("method", "windows", "ms", "CPU ms", "faster", "MAE µm", "near edges µm", "edges")
    title = f"Fixed case: {rows[0]['events']:,} events in {1e3 * rows[0]['window_s']:g} ms"
    return Table(title, head, cells, note)


def _scaling(rows: Sequence[Row]) -> Table:
    cells = []
    for key in dict.fromkeys((r["quantity"], r["value"], r["method"]) for r in rows):
        quantity, value, method = key
        own = where(rows, quantity=quantity, value=value, method=method)
        spent = sorted(values(own, "ms"))
        middle = spent[len(spent) // 2] if spent else None
        spread = _spread(spent[0], spent[-1]) if spent else "–"
        cpu_ms = number(mean(own, "cpu_ms"), 1)
        cells.append((f"{quantity}: {value:,}", method, number(middle, 1), cpu_ms, spread))
    note = f"The densest window of {rows[0]['object']} at {rows[0]['speed']:g} m/s."
    return Table("Cost as the work grows", ("quantity", "method", "ms", "CPU ms", "spread"), cells,
                 note)  # fmt: skip


def _spread(low: float | None, high: float | None) -> str:
    return "–" if low is None or high is None else f"{low:.1f}–{high:.1f}"
