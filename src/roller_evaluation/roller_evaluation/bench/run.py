"""A whole benchmark: scans, cases, savings, growth, the fixed case; files of results."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.output_folder import make_folder
from roller_core.progress import Tell, tell_nobody
from roller_evaluation.tables import write_json

from .bench_tables import write_markdown
from .cases import SAVINGS, Case, plan
from .fixed import fixed_pieces, run_fixed
from .growth import run_growth
from .measure import CaseRun, run_rounds
from .options import DENSE_OBJECTS, BenchOptions
from .pareto import pareto_front
from .plots import draw_growth, draw_speed_vs_error
from .scans import Scan, get_scan
from .slider import run_slider

#: The paper: ms a window (EMVS, laptop with an i7-1365U) and µm (mean absolute error).
PAPER = {"ms": 377.41, "error_um": 62.0, "label": "paper: 377 ms, 62 µm"}
#: A case is on the Pareto front only if it measures this share of the edges that the best does:
#: leaving out what is hard is no merit.
_LEAST_EDGES = 0.5


def run_bench(options: BenchOptions, output: Path, tell: Tell = tell_nobody) -> dict[str, Any]:
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
    rows = bench.measure(plan(options))
    result: dict[str, Any] = {
        "version": 2,
        "machine": machine(),
        "options": {k: v for k, v in asdict(options).items() if k != "slider"},
        "paper": PAPER,
        "cases": rows,
        "pareto": {
            # A block of `surface` is no window.
            "ms": front_of([r for r in rows if r["method"] != "surface"], options.speeds[0], "ms"),
            "ms_per_mev": front_of(rows, options.speeds[0], "ms_per_mev"),
        },
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


def front_of(rows: list[dict[str, Any]], speed: float, time: str) -> list[str]:
    """Labels of the cases on the Pareto front of a time and the error, at one speed."""
    here = [r for r in rows if r["speed"] == speed and r["time"]["ms"] and error_of(r) is not None]
    most = max((r["error"]["edges_measured"] or 0.0 for r in here), default=0.0)
    here = [r for r in here if (r["error"]["edges_measured"] or 0.0) >= _LEAST_EDGES * most]
    points = [(float(r["time"][time]), float(r["error"]["near_edge_mae_um"])) for r in here]
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
    """The parts of a run, over scans that are held in memory."""

    def __init__(self, options: BenchOptions, folder: Path, tell: Tell) -> None:
        self._options = options
        self._folder = folder
        self._tell = tell
        self._scans: dict[tuple[str, float], Scan] = {}

    def scan(self, name: str, speed: float) -> Scan:
        """A scan, simulated or read once."""
        if (name, speed) not in self._scans:
            self._tell(f"scan of {name} at {speed:g} m/s", 0.0)
            scan = get_scan(self._folder, name, speed, self._options.cell)
            self._scans[name, speed] = scan
        return self._scans[name, speed]

    def measure(self, cases: list[Case]) -> list[dict[str, Any]]:
        """Measure cases, one row each."""
        runs = [self._prepare(case) for case in cases]
        self._rounds(runs, 0.1, 0.5)
        return [_row(run) for run in runs]

    def savings(self) -> list[dict[str, Any]]:
        """Each saving of the depth engine, with it and without it, in turns."""
        o, rows = self._options, []
        speed = o.speeds[0]
        for number, (title, on, off, methods) in enumerate(SAVINGS):
            mine = [m for m in methods if m in o.methods]
            # 500 planes take long, and a quick run has the case without savings.
            if o.quick:
                mine = [] if off.get("planes") else mine[:1]
            for method in mine:
                pair = [
                    self._prepare(Case(method, title, "on", speed, on)),
                    self._prepare(Case(method, title, "off", speed, off)),
                ]
                start = 0.6 + 0.15 * number / len(SAVINGS)
                self._rounds(pair, start, 0.15 / len(SAVINGS))
                with_it, without = (_row(run) for run in pair)
                rows.append(
                    {
                        "saving": title,
                        "method": method,
                        "on": _brief(with_it),
                        "off": _brief(without),
                        "times_faster": _gain(*pair),
                    }
                )
        return rows

    def _prepare(self, case: Case) -> CaseRun:
        return CaseRun(case, [self.scan(name, case.speed) for name in self._options.objects])

    def _rounds(self, runs: list[CaseRun], start: float, length: float) -> None:
        o, done = self._options, 0

        def tell(run: CaseRun) -> None:
            nonlocal done
            text = f"{run.case.method}: {run.case.factor}, {run.case.value}"
            self._tell(text, start + length * done / (len(runs) * o.repeats))
            done += 1

        run_rounds(runs, o.repeats, o.case_budget_s, tell)

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


def _row(run: CaseRun) -> dict[str, Any]:
    case = run.case
    return {
        "label": case.label,
        "method": case.method,
        "factor": case.factor,
        "value": case.value,
        "speed": case.speed,
        "changes": dict(case.changes),
        **run.figures(),
    }


def _brief(row: dict[str, Any]) -> dict[str, Any]:
    error = {k: row["error"][k] for k in ("near_edge_mae_um", "edges_measured")}
    return {k: row["time"].get(k) for k in ("ms", "ms_low", "ms_high")} | error


def _gain(on: CaseRun, off: CaseRun) -> float | None:
    """Times faster: median over the turns, of which each compares neighbours in time."""
    turns = [b / a for a, b in zip(on.medians, off.medians, strict=False)]
    return round(float(np.median(turns)), 2) if turns else None
