"""How long methods take for a window, one after the other on an otherwise idle machine."""

from __future__ import annotations

from typing import Any

import numpy as np

from roller_emvs.windows import RefusedWindow
from roller_evaluation.bench.measure import events_for, results_of
from roller_evaluation.bench.scans import Scan

from . import paper_values as published
from .paper_tables import NAMES
from .plan import FUSIONS
from .repeated_passes import settings_of
from .tables import Table

_THREADS = 2
_WINDOWS = {"surface": "a block of rows", "focus": "20 mm of travel"}


def window_times(scan: Scan, repeats: int) -> list[dict[str, Any]]:
    """Mean and deviation over runs of the time for a window, by method.

    Parameters
    ----------
    scan : Scan
        Of one object.
    repeats : int
        Runs, after a first that compiles.
    """
    rows = []
    for method in FUSIONS:
        settings = settings_of(method, _THREADS)
        events = events_for(settings, scan)
        means, windows = [], 0
        for _ in range(repeats + 1):
            found = [
                f for f in results_of(settings, scan, events) if not isinstance(f, RefusedWindow)
            ]
            windows = len(found)
            means.append(sum(f.milliseconds["total"] for f in found) / max(windows, 1))
        each = np.array(means[1:])
        rows.append(
            {
                "method": method,
                "ms": round(float(each.mean()), 2),
                "deviation_ms": round(float(each.std(ddof=1)), 2) if repeats > 1 else None,
                "windows": windows,
                "events": len(events) // max(windows, 1),
            }
        )
    return rows


def time_table(rows: list[dict[str, Any]], scene: str) -> Table:
    """Times beside the paper's."""
    mean, deviation = published.WINDOW_MS
    cells = [("EMVS, the paper (laptop, i7-1365U)", f"{mean:.1f} ± {deviation:.1f}", "20 ms", "–")]
    for row in rows:
        about = f" ± {row['deviation_ms']:.1f}" if row["deviation_ms"] is not None else ""
        what = _WINDOWS.get(row["method"], "20 ms")
        cells.append(
            (NAMES[row["method"]], f"{row['ms']:.1f}{about}", what, f"{row['events']:,}")
        )  # fmt: skip
    note = (
        f"{scene}, 0.3 m/s, {_THREADS} threads; mean of a run's windows, and its deviation between "
        "runs. Times are of the machine that this page was made on and differ from run to run."
    )
    return Table("Processing time", ("method", "ms", "for", "events"), cells, note)
