"""The account of a soak as a page and as data."""

import statistics
from typing import Any

import numpy as np

from .graph import FLOWS, NODES, PAGE, Graph, Instance

#: Memory is looked at from so long after a process's start, over at least so long, s.
WARM_S, LEAST_S = 120.0, 120.0


def growth(instance: Instance) -> tuple[float, float] | None:
    """Memory, MB, and handles that a process grew by a minute once it was warm."""
    warm = [s for s in instance.samples if s[0] - instance.begin_s > WARM_S]
    if not warm or warm[-1][0] - warm[0][0] < LEAST_S:
        return None
    minutes = [(s[0] - warm[0][0]) / 60 for s in warm]
    return tuple(float(np.polyfit(minutes, [s[k] for s in warm], 1)[0]) for k in (1, 2))  # type: ignore[return-value]


def quarters(instance: Instance) -> str | None:
    """Median memory, MB, in each quarter of a process's time: growth goes on, warm-up doesn't."""
    parts = np.array_split(np.array([s[1] for s in instance.samples]), 4)
    return ", ".join(f"{np.median(p):.0f}" for p in parts) if len(parts[-1]) else None


def _lived(instance: Instance) -> float:
    return instance.samples[-1][0] - instance.begin_s if instance.samples else 0.0


def table(
    graph: Graph, rows: list[dict[str, Any]], seconds: float, seed: int
) -> tuple[str, dict[str, Any]]:
    """The account, as a page and as data; a row is what came of a fault."""
    done = [r for r in rows if r["outcome"] != "skipped"]
    survived = sum(r["outcome"] == "survived" for r in done)
    late = sorted(graph.latencies)
    accounts = graph.ledger.accounts
    figures: dict[str, Any] = {
        "minutes": round(seconds / 60, 1),
        "seed": seed,
        "metres rolled": round(graph.rolled_m, 1),
        "faults injected": len(done),
        "survived": survived,
        "skipped": len(rows) - len(done),
        "messages accounted for": sum(a.sent for a in accounts),
        "lost and counted": sum(a.counted for a in accounts),
        "lost and not counted": sum(a.uncounted for a in accounts),
        "latency, median s": round(statistics.median(late), 2) if late else None,
        "latency, 95 % s": round(late[int(0.95 * (len(late) - 1))], 2) if late else None,
    }
    nodes = {}
    for name in (*NODES, PAGE):
        own = [i for i in graph.instances if i.name == name]
        grown = [(i.samples[-1][0] - i.begin_s, g) for i in own if (g := growth(i)) is not None]
        slopes = max(grown)[1] if grown else (None, None)
        most = max((s[1] for i in own for s in i.samples), default=0.0)
        nodes[name] = {
            "processes": len(own),
            "most MB": round(most),
            "MB by quarter": quarters(max(own, key=_lived)) if own else None,
            "MB a minute": None if slopes[0] is None else round(slopes[0], 2),
            "handles a minute": None if slopes[1] is None else round(slopes[1], 2),
        }
    flows = {}
    for flow in FLOWS:
        own_accounts = [a for a in accounts if a.flow == flow]
        flows[f"{flow.topic} to {flow.consumer}"] = {
            "sent": sum(a.sent for a in own_accounts),
            "lost and counted": sum(a.counted for a in own_accounts),
            "not counted": sum(a.uncounted for a in own_accounts),
            "not known at a process's end": sum(a.open for a in own_accounts),
        }
    fates = {
        f"{r['at_s']} s: {r['fault']}": {k: r[k] for k in ("outcome", "recovery_s", "said")}
        for r in rows
    }
    lines = ["# Soak", "", "| | |", "|---|---|"]
    lines += [f"| {k} | {_cell(v)} |" for k, v in figures.items()]
    lines += _rows("node", nodes) + _rows("messages", flows) + _rows("fault", fates)
    data = {"totals": figures, "nodes": nodes, "flows": flows, "faults": rows}
    return "\n".join(lines) + "\n", data


def _cell(value: object) -> str:
    return "–" if value is None else str(value)


def _rows(what: str, by_name: dict[str, dict[str, Any]]) -> list[str]:
    """A table of a row for each name."""
    if not by_name:
        return []
    heads = [what, *next(iter(by_name.values()))]
    lines = ["", f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return lines + [
        f"| {' | '.join([name, *map(_cell, row.values())])} |" for name, row in by_name.items()
    ]
