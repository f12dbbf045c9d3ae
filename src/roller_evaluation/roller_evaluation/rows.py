"""Tidy rows: flat dicts, one a measurement, that tables and pictures are made from."""

from __future__ import annotations

import csv
import io
import os
import platform
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .tables import write_text

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
    found = values(rows, column)
    return float(np.mean(found)) if found else None


def deviation(rows: Iterable[Row], column: str) -> float | None:
    """Standard deviation of a column; None of a single value."""
    found = values(rows, column)
    return float(np.std(found, ddof=1)) if len(found) > 1 else None


def mean_of(found: Iterable[float | None]) -> float | None:
    """Mean of what there is."""
    known = [v for v in found if v is not None]
    return float(np.mean(known)) if known else None


def write_rows(rows: Sequence[Row], path: Path) -> None:
    """Write rows as CSV, with all columns that one of them has.

    Raises
    ------
    UnwritableOutputError
        If the file can't be written.
    """
    out = io.StringIO()
    columns = dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(out, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, out.getvalue())


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
