"""The account of a run: `report.json`."""

from __future__ import annotations

import platform
from collections import Counter
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.errors import RollerError
from roller_core.plain_json import to_text
from roller_core.window_account import WindowAccount
from roller_emvs.lines.edge_drift import NOT_CALIBRATED


@dataclass
class Report:
    """Gathers what happened, window by window."""

    #: What was processed.
    source: str
    #: Depth method.
    method: str
    #: All settings in force.
    settings: dict[str, Any]
    #: For pictures; the name of the source's file by default.
    title: str = ""
    #: Whether the instrument's drift of edges was calibrated, and so corrected.
    edge_drift: str = NOT_CALIBRATED
    windows: list[dict[str, Any]] = field(default_factory=list)
    totals: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, Any] | None = None
    _faults: Counter[str] = field(default_factory=Counter)
    _first_fault: dict[str, str] = field(default_factory=dict)

    def add_window(self, stamp_ns: int, account: WindowAccount) -> None:
        """Note a depth map, rows of the surface, or a window that was refused."""
        self.windows.append(
            {
                "stamp_s": stamp_ns * 1e-9,
                "stamp_ns": stamp_ns,
                "start_s": account.start_ns * 1e-9,
                "end_s": account.end_ns * 1e-9,
                "events": account.events,
                "points": account.points,
                "milliseconds": account.milliseconds,
                "cpu_ms": account.cpu_ms,
                "lost": list(account.lost),
            }
        )

    def add_bare_window(self, stamp_ns: int, points: int) -> None:
        """Note a window of which no more is known than how many points it gave."""
        bare = {"points": points, "milliseconds": {}, "lost": []}
        self.windows.append({"stamp_s": stamp_ns * 1e-9, "stamp_ns": stamp_ns, **bare})

    def add_fault(self, fault: RollerError) -> None:
        """Note a fault; of each kind the first line is kept and the rest counted."""
        kind = type(fault).__name__
        self._faults[kind] += 1
        self._first_fault.setdefault(kind, str(fault))

    @property
    def faults(self) -> list[str]:
        """One line a kind of fault."""
        lines = []
        for kind, count in self._faults.items():
            more = f" (and {count - 1} more of this kind)" if count > 1 else ""
            lines.append(self._first_fault[kind] + more)
        return lines

    @property
    def is_empty(self) -> bool:
        """Whether nothing came of the run: no depth map, no point, no character."""
        return not any(
            self.totals[key] for key in ("depth_windows", "surface_points", "braille_cells")
        )

    def window_milliseconds(self) -> dict[str, float]:
        """Median and 95th percentile of the time a window took, ms."""
        spent = [w["milliseconds"]["total"] for w in self.windows if w["milliseconds"]]
        if not spent:
            return {}
        return {
            "median": round(float(np.median(spent)), 3),
            "p95": round(float(np.percentile(spent, 95)), 3),
        }

    def write(self, path: Path) -> None:
        """Write the report."""
        data = {
            "source": self.source,
            "title": self.title or Path(self.source).name,
            "method": self.method,
            "edge_drift": self.edge_drift,
            "totals": {**self.totals, "window_milliseconds": self.window_milliseconds()},
            "truth": self.truth,
            "faults": self.faults,
            "windows": self.windows,
            "settings": self.settings,
            "versions": versions(),
        }
        path.write_text(to_text(data), encoding="utf-8")


def versions() -> dict[str, str]:
    """Of Python, the machine and what the figures depend on."""
    found = {"python": platform.python_version(), "machine": platform.platform()}
    for name in ("numpy", "numba", "opencv-contrib-python-headless", "roller_emvs"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
