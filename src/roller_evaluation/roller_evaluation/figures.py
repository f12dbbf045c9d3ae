"""Columns that several measures have: errors of an object, times of windows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .rows import Row

#: Error columns, in the order they are shown.
ERRORS = (
    "near_edge_mae_um", "mae_um", "median_um", "bias_um", "within_100_um", "edges_measured",
    "points",
)  # fmt: skip


def object_errors(summary: dict[str, Any], name: str) -> Row:
    """One object's errors in a tally's summary; all there is for a plate without objects."""
    figures = dict(summary["objects"].get(name, summary["all"]))
    # An object without relief edges has no share of them.
    return {k: v if (v := figures.get(k)) is None or np.isfinite(v) else None for k in ERRORS}


def time_columns(spent_ms: Sequence[float]) -> Row:
    """Median, mean and 95th percentile of windows' times, ms; None without windows."""
    if not len(spent_ms):
        return {"ms": None, "ms_mean": None, "ms_p95": None}
    return {
        "ms": round(float(np.median(spent_ms)), 3),
        "ms_mean": round(float(np.mean(spent_ms)), 3),
        "ms_p95": round(float(np.percentile(spent_ms, 95)), 3),
    }
