"""A whole benchmark: scans, cases, savings, growth, the fixed case; files of results."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from roller_bringup.results.folders import make_folder

from .cases import SAVINGS, Case, offered, plan
from .fixed import fixed_pieces, run_fixed
from .growth import run_growth
from .measure import can_measure, measure
from .options import DENSE_OBJECTS, BenchOptions
from .pareto import pareto_front
from .plots import draw_growth, draw_speed_vs_error
from .report import write_json, write_markdown
from .scans import Scan, get_scan
from .slider import run_slider

#: The paper: ms a window (EMVS, laptop with an i7-1365U) and µm (mean absolute error).
PAPER = {"ms": 377.41, "error_um": 62.0, "label": "paper: 377 ms, 62 µm"}
#: A case is on the Pareto front only if it measures this share of the edges that the best does:
#: leaving out what is hard is no merit.
_LEAST_EDGES = 0.5

Tell = Callable[[str, float], None]


def run_bench(
    options: BenchOptions, output: Path, tell: Tell = lambda _text, _share: None
) -> dict[str, Any]:
    """Measure everything and write `bench.json`, `bench.md` and the figures.

    Parameters
    ----------
    options : BenchOptions
        Size of the run.
    output : path
        Folder for the results; scans are kept in `scans` there.
    tell : callable
        Told what is being done and the share done, 0–1.

    Returns
    -------
    dict
        What `bench.json` holds.

    Raises
    ------
    UnwritableOutputError
        If results can't be written.
    RollerError
        If an object or the slider's folder is no good.
    """
    make_folder(output)
    bench = _Bench(options, output / "scans", tell)
    cases = [case for case in plan(options) if can_measure(case.method)]
    rows = bench.measure_all(cases)
    result: dict[str, Any] = {
        "version": 1,
        "machine": machine(),
        "options": {k: v for k, v in asdict(options).items() if k != "slider"},
        "left_out": [m for m in options.methods if not can_measure(m)],
        "paper": PAPER,
        "cases": rows,
        "pareto": front_of(rows, options.speeds[0]),
        "savings": bench.savings(),
        "growth": bench.growth(),
        "fixed": bench.fixed(),
        "slider": None,
    }
    if options.slider is not None:
        tell("slider_depth", 0.95)
        result["slider"] = run_slider(options.slider, options.repeats)
    tell("results", 1.0)
    write_json(result, output / "bench.json")
    write_markdown(result, output / "bench.md")
    draw_speed_vs_error(result, output / "speed_vs_error.png")
    draw_growth(result, output / "growth.png")
    return result


def front_of(rows: list[dict[str, Any]], speed: float) -> list[str]:
    """Labels of the cases on the Pareto front of time and error, at one speed."""
    here = [r for r in rows if r["speed"] == speed and r["time"]["ms"] and error_of(r) is not None]
    most = max((r["error"]["edges_measured"] or 0.0 for r in here), default=0.0)
    here = [r for r in here if (r["error"]["edges_measured"] or 0.0) >= _LEAST_EDGES * most]
    points = [(float(r["time"]["ms"]), float(r["error"]["near_edge_mae_um"])) for r in here]
    return [here[k]["label"] for k in pareto_front(points)]


def error_of(row: dict[str, Any]) -> float | None:
    """The error by which cases are compared, µm."""
    value = row["error"]["near_edge_mae_um"]
    return None if value is None else float(value)


def machine() -> dict[str, Any]:
    """What the times belong to."""
    name = platform.processor()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    except OSError:
        pass
    return {"processor": name, "cores": os.cpu_count(), "python": platform.python_version()}


class _Bench:
    """Scans in memory and cases that are measured already."""

    def __init__(self, options: BenchOptions, folder: Path, tell: Tell) -> None:
        self._options = options
        self._folder = folder
        self._tell = tell
        self._scans: dict[tuple[str, float], Scan] = {}
        self._found: dict[str, dict[str, Any]] = {}

    def scan(self, name: str, speed: float) -> Scan:
        """A scan, simulated or read once."""
        if (name, speed) not in self._scans:
            scan = get_scan(self._folder, name, speed, self._options.cell)
            self._scans[name, speed] = scan
        return self._scans[name, speed]

    def measure_all(self, cases: list[Case]) -> list[dict[str, Any]]:
        """Measure cases, one row each."""
        rows = []
        for k, case in enumerate(cases):
            self._tell(case.label, 0.05 + 0.5 * k / len(cases))
            rows.append(self.row(case))
        return rows

    def row(self, case: Case) -> dict[str, Any]:
        """One case's row."""
        o = self._options
        if case.key not in self._found:
            scans = [self.scan(name, case.speed) for name in o.objects]
            self._found[case.key] = measure(case, scans, o.repeats, o.case_budget_s)
        return {
            "label": case.label,
            "method": case.method,
            "factor": case.factor,
            "value": case.value,
            "speed": case.speed,
            "changes": dict(case.changes),
            **self._found[case.key],
        }

    def savings(self) -> list[dict[str, Any]]:
        """Each saving of the depth engine, with it and without it."""
        o, rows = self._options, []
        speed = o.speeds[0]
        for number, (title, on, off, methods) in enumerate(SAVINGS):
            for method in (m for m in methods if m in o.methods):
                self._tell(f"saving: {title}, {method}", 0.55 + 0.2 * number / len(SAVINGS))
                row: dict[str, Any] = {"saving": title, "method": method}
                # TODO(merge): every saving is offered then.
                row["offered"] = offered(method, on)
                if row["offered"]:
                    with_it = self.row(Case(method, title, "on", speed, on))
                    without = self.row(Case(method, title, "off", speed, off))
                    row |= {
                        "on": _brief(with_it),
                        "off": _brief(without),
                        "times_faster": _ratio(without["time"]["ms"], with_it["time"]["ms"]),
                    }
                rows.append(row)
        return rows

    def growth(self) -> dict[str, Any]:
        """Cost as the work grows."""
        o = self._options
        scan = self.scan(self._dense()[0], o.fixed_speed)
        return run_growth(scan, o, lambda text: self._tell(text, 0.78))

    def fixed(self) -> dict[str, Any]:
        """The fixed case."""
        o = self._options
        self._tell("fixed case", 0.87)
        scans = [self.scan(name, o.fixed_speed) for name in self._dense()]
        return run_fixed(fixed_pieces(scans, o), o)

    def _dense(self) -> list[str]:
        dense = [name for name in DENSE_OBJECTS if name in self._options.objects]
        return dense or [self._options.objects[0]]


def _brief(row: dict[str, Any]) -> dict[str, Any]:
    error = {k: row["error"][k] for k in ("near_edge_mae_um", "edges_measured")}
    return {k: row["time"].get(k) for k in ("ms", "ms_low", "ms_high")} | error


def _ratio(without: float | None, with_it: float | None) -> float | None:
    return round(without / with_it, 2) if without and with_it else None
