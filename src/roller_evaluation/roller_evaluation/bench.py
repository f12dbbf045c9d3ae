"""A whole benchmark: depth cases, scaling, the fixed case; files of results."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.codecs import encode
from roller_core.event_stream import EventStream
from roller_core.progress import OnProgress, no_progress, part_of

from .bench_plan import BenchOptions, depth_cases, fixed_cases
from .bench_plots import draw_scaling, draw_speed_vs_error
from .bench_tables import tables
from .figures import ERRORS
from .measures import STAGE_COLUMNS
from .rows import Row, mean, provenance, rounded, values, where, write_rows
from .run import run_timed
from .scaling import scaling_cases
from .scans import Scan, ScanStore
from .tables import markdown_page, write_json

#: The paper: ms a window (EMVS, laptop with an i7-1365U) and µm (mean absolute error).
PAPER = {"ms": 377.41, "error_um": 62.0, "label": "paper: 377 ms, 62 µm"}
#: Said of a run that was interrupted.
INCOMPLETE = "INCOMPLETE: it was interrupted; what isn't here wasn't measured."
#: A case is on the Pareto front only if it measures this share of the edges that the best does:
#: leaving out what is hard is no merit.
_LEAST_EDGES = 0.5
_TIMES = ("ms", "ms_p95", "ms_per_mev", "cpu_ms", "cpu_ms_per_mev")


@dataclass
class Measured:
    """Rows of a benchmark, filled while it runs; an interrupt leaves what came before it."""

    #: Of the depth cases, of the scaling and of the fixed case.
    depth: list[Row] = field(default_factory=list)
    grown: list[Row] = field(default_factory=list)
    fixed: list[Row] = field(default_factory=list)
    #: See `decoding_cpu_ns`; it comes last.
    decoding_cpu_ns: float | None = None

    @property
    def complete(self) -> bool:
        """Whether all was measured."""
        return self.decoding_cpu_ns is not None


def measure(
    options: BenchOptions, scans_folder: Path, into: Measured, on_progress: OnProgress = no_progress
) -> None:
    """Measure everything, row by row; `write_bench` writes it.

    Parameters
    ----------
    options : BenchOptions
        Size of the run.
    scans_folder : path
        Where scans are kept.
    into : Measured
        Takes what was measured.
    on_progress : callable
        Takes what is being done and the share done, 0–1.

    Raises
    ------
    RollerError
        If an object is no good.
    """
    o = options
    scans = ScanStore(scans_folder, hold=len(o.objects) * (len(o.speeds) + 2), threads=0)
    part = partial(part_of, on_progress)
    run_timed(depth_cases(o), scans, o.repeats, o.case_budget_s, part(0.0, 0.7), into.depth)
    scaling = scaling_cases(o.scan(o.dense[0], o.fixed_speed), o)
    # The first round compiles and doesn't count.
    run_timed(scaling, scans, o.repeats + 1, on_progress=part(0.7, 0.85), rows=into.grown)
    run_timed(fixed_cases(o), scans, 1, on_progress=part(0.85, 0.95), rows=into.fixed)
    into.decoding_cpu_ns = decoding_cpu_ns(scans.get(o.scan(o.dense[0], o.fixed_speed)))
    on_progress("results", 1.0)


def write_bench(options: BenchOptions, measured: Measured, output: Path) -> dict[str, Any]:
    """Write `bench.json`, `bench.md`, `rows.csv` and, of a whole run, the pictures.

    Returns
    -------
    dict
        What `bench.json` holds.
    """
    cases = summarise(measured.depth)
    # A mean over other objects is of another scale.
    whole = [c for c in cases if len(c["objects"]) == len(options.objects)]
    whole = [c for c in whole if c["factor"] != "coating"]
    result: dict[str, Any] = {
        "version": 3,
        "complete": measured.complete,
        "machine": provenance(),
        "options": asdict(options),
        "paper": PAPER,
        "cases": cases,
        "decoding_cpu_ns": measured.decoding_cpu_ns,
        "pareto": fronts(whole, options.speeds[0]),
        "growth": [r for r in measured.grown if r["run"]],
        "fixed": measured.fixed,
    }
    write_rows([*measured.depth, *result["growth"], *measured.fixed], output / "rows.csv")
    write_json(result, output / "bench.json")
    about = f"{result['machine']['processor']}, {result['machine']['cores']} cores."
    if not measured.complete:
        about += f" {INCOMPLETE}"
    page = markdown_page("Speed against error", about, tables(result))
    (output / "bench.md").write_text(page, encoding="utf-8")
    if measured.complete:
        draw_speed_vs_error(result, output / "speed_vs_error.png")
        draw_scaling(result["growth"], output / "growth.png")
    return result


def summarise(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows of `measure_depth` by configuration and speed, over objects and runs.

    Returns
    -------
    list of dict
        `time`: of each column the mean over the objects of the median over runs, with the
        spread of the runs as `_low` and `_high`; `error`: mean over the objects, each counting
        the same however many points it has; `objects`: each one's errors; `stages`: mean
        processor time by stage, ns an event.
    """
    found: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        found.setdefault((row["label"], row["speed"]), []).append(row)
    out = []
    for own in found.values():
        first = [r for r in own if r["run"] == 0]
        measured = [r for r in first if r["points"]]
        error = {k: rounded(mean(measured, k), 4) for k in ERRORS if k != "points"}
        keys = ("label", "method", "factor", "value", "speed")
        case = {k: own[0][k] for k in keys}
        counts = {k: int(sum(values(first, k))) for k in ("windows", "refused")}
        out.append(
            case
            | {
                "time": _times(own) | counts,
                "error": {"objects": len(measured), **error},
                "objects": {r["object"]: {k: r[k] for k in ERRORS} for r in first},
                "stages": {
                    stage: round(spent, 1)
                    for stage, column in STAGE_COLUMNS.items()
                    if (spent := mean(own, column)) is not None
                },
            }
        )
    return out


def _times(rows: Sequence[Row]) -> dict[str, Any]:
    names = dict.fromkeys(r["object"] for r in rows)
    runs = min(len(where(rows, object=name)) for name in names)
    out: dict[str, Any] = {"repeats": runs}
    for column in _TIMES:
        each = sorted(v for k in range(runs) if (v := mean(where(rows, run=k), column)) is not None)
        for end, place in (("_low", 0), ("", len(each) // 2), ("_high", -1)):
            out[column + end] = rounded(each[place] if each else None, 3)
    return out


def fronts(cases: Sequence[dict[str, Any]], speed: float) -> dict[str, list[str]]:
    """Labels of the cases at one speed that no other beats, by column of time."""
    # A block of `surface` is no window.
    windows = [c for c in cases if c["method"] != "surface"]
    return {
        "ms": front_of(windows, speed, "ms"),
        "ms_per_mev": front_of(cases, speed, "ms_per_mev"),
    }


def front_of(cases: Sequence[dict[str, Any]], speed: float, time: str) -> list[str]:
    """Labels of the cases on the Pareto front of a time and the error, at one speed."""
    here = [
        c
        for c in cases
        if c["speed"] == speed and c["time"][time] and c["error"]["near_edge_mae_um"] is not None
    ]
    most = max((c["error"]["edges_measured"] or 0.0 for c in here), default=0.0)
    here = [c for c in here if (c["error"]["edges_measured"] or 0.0) >= _LEAST_EDGES * most]
    points = [(float(c["time"][time]), float(c["error"]["near_edge_mae_um"])) for c in here]
    return [here[k]["label"] for k in pareto_front(points)]


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Points that no other is as good as in both coordinates and better in one.

    Parameters
    ----------
    points : sequence of (float, float)
        Less is better.

    Returns
    -------
    list of int
        Their places in the sequence, by the first coordinate. Points that are equal to each
        other are all on the front or all off it.
    """
    order = sorted(range(len(points)), key=lambda k: points[k])
    front: list[int] = []
    for k in order:
        if not front or points[k][1] < points[front[-1]][1] or points[k] == points[front[-1]]:
            front.append(k)
    return front


_ENCODING = "libcaer_cmp"
#: Length of a packet, and how often all are decoded.
_PACKET_NS, _RUNS = 1_000_000, 3


def decoding_cpu_ns(scan: Scan) -> float:
    """Processor time of `EventStream` for an event of a scan, ns; the median of some runs."""
    events, camera = scan.even, scan.camera
    times = np.arange(events.t_ns[0], events.t_ns[-1] + _PACKET_NS, _PACKET_NS)
    ends = np.searchsorted(events.t_ns, times)
    packets = [
        (int(t), encode(_ENCODING, events[a:b], int(t)))
        for t, a, b in zip(times[:-1], ends[:-1], ends[1:], strict=True)
    ]
    spent = []
    for _ in range(_RUNS):
        stream = EventStream(camera.width, camera.height)
        begin = time.process_time()
        for seq, (t, payload) in enumerate(packets):
            stream.push(_ENCODING, camera.width, camera.height, seq, t, t, payload)
        spent.append((time.process_time() - begin) * 1e9 / max(stream.counts.events, 1))
    return round(float(np.median(spent)), 1)
