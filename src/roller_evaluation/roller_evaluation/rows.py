"""Tidy rows: flat dicts, one a measurement, that tables and pictures are made from."""

from __future__ import annotations

import csv
import os
import platform
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]

_LIBRARIES = ("numpy", "numba", "scipy", "opencv-contrib-python-headless")


def where(rows: Iterable[Row], **columns: Any) -> list[Row]:
    """Rows that hold these values."""
    return [r for r in rows if all(r.get(k) == v for k, v in columns.items())]


def values(rows: Iterable[Row], column: str) -> list[float]:
    """A column's values; rows without one are left out."""
    found = (r.get(column) for r in rows)
    return [float(v) for v in found if v is not None]


def mean(rows: Iterable[Row], column: str) -> float | None:
    """Mean of a column; None without values."""
    return mean_of(values(rows, column))


def deviation(rows: Iterable[Row], column: str) -> float | None:
    """Standard deviation of a column; None of a single value."""
    found = values(rows, column)
    return float(np.std(found, ddof=1)) if len(found) > 1 else None


def mean_of(found: Iterable[float | None]) -> float | None:
    """Mean of what there is."""
    known = [v for v in found if v is not None]
    return float(np.mean(known)) if known else None


def rounded(value: float | np.floating | None, digits: int = 1) -> float | None:
    """A figure without the digits that say nothing."""
    return None if value is None else round(float(value), digits)


def write_rows(rows: Sequence[Row], path: Path) -> None:
    """Write rows as CSV, with all columns that one of them has."""
    columns = dict.fromkeys(name for row in rows for name in row)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def provenance() -> dict[str, Any]:
    """Machine, date and versions that rows belong to."""
    name = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    except OSError:
        pass
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "date": datetime.now(timezone.utc).date().isoformat(),
        "python": platform.python_version(),
        **{library: version(library) for library in _LIBRARIES},
    }
