"""Processing times beside the paper's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from . import paper_values as paper
from .experiments import THREADS
from .paper_tables import NAMES
from .rows import Row, mean, mean_of, where
from .tables import Table, number, share

_WINDOWS = {"surface": "a block of rows", "focus": "24.5 mm of travel"}


def processing_time(rows: Sequence[Row]) -> Table:
    """Times beside the paper's: mean over the objects, deviation between runs."""
    values_ms, about = paper.WINDOW_MS
    cells = [
        ("EMVS, the paper (laptop, i7-1365U)", "–", f"{values_ms:.1f} ± {about:.1f}", "20 ms", "–",
         "–", "–", "–")
    ]  # fmt: skip
    for speed_m_s, method in dict.fromkeys((r["speed"], r["method"]) for r in rows):
        own = where(rows, speed=speed_m_s, method=method)
        runs = [mean(where(own, run=k), "ms_mean") for k in dict.fromkeys(r["run"] for r in own)]
        spent = [v for v in runs if v is not None]
        spread = f" ± {np.std(spent, ddof=1):.1f}" if len(spent) > 1 else ""
        cells.append(
            (
                NAMES[method], f"{speed_m_s:g}", f"{number(mean_of(spent))}{spread}",
                _WINDOWS.get(method, "20 ms"), number(mean(own, "ms_per_mev"), 0),
                number(mean(own, "cpu_ms_per_mev"), 0), number(mean(own, "near_edge_mae_um")),
                share(mean(own, "edges_measured")),
            )
        )  # fmt: skip
    head = ("method", "m/s", "ms", "for", "ms/10⁶ events", "CPU ms/10⁶", "near edges µm", "edges")
    names = ", ".join(dict.fromkeys(r["object"] for r in rows))
    note = (
        f"{names}; {THREADS} threads. ms: mean of a run's windows, and its deviation between runs; "
        "CPU: of all threads. Errors near relief edges, and the share of edges measured. Times "
        "are of the machine that this page was made on and differ from run to run."
    )
    return Table("Processing time and error", head, cells, note)
