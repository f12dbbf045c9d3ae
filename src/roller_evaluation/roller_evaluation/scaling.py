"""Cost as the work grows: events a window, planes, threads."""

from __future__ import annotations

import time
from typing import Any

from roller_emvs.depth_map import DepthMap
from roller_emvs.pipeline import DepthPipeline

from .bench_plan import BenchOptions
from .cases import Case, ScanCase, depth_settings
from .figures import time_columns
from .rows import Row
from .scans import Scan
from .windows import densest_piece

METHODS = ("focus", "bma")


def scaling_cases(scan: ScanCase, options: BenchOptions) -> list[Case]:
    """One real window while one quantity grows; the column `quantity` says which."""
    o, cases = options, []

    def add(quantity: str, value: Any, method: str, **changes: Any) -> None:
        settings = {"window_s": o.fixed_window_s, "events": o.fixed_events, **changes}
        labels = {"quantity": quantity, "value": value}
        cases.append(Case(scan, "window", method, settings, labels))

    for method in METHODS:
        for count in o.scaling_events:
            add("events", count, method, events=count)
        for threads in o.scaling_threads:
            add("threads", threads, method, depth={"threads": threads})
    for planes in o.scaling_planes:
        # `focus` takes as many planes as the parallax asks for.
        add("planes", planes, "bma", depth={"paper.plane_rule": "fixed", "paper.planes": planes})
    return cases


def measure_window(case: Case, scan: Scan) -> list[Row]:
    """Time of the densest window of a scan, with as many events as a case says.

    Its settings: `window_s`, `events` and `depth`, those of the method.
    """
    s = case.settings
    piece = densest_piece(scan, s["window_s"], s["events"])
    settings = depth_settings(case.method, **{"window.rule": "all"}, **s.get("depth", {}))
    pipeline = DepthPipeline(settings, scan.camera, scan.track)
    pipeline.add_events(piece.events)
    cpu = time.process_time()
    found = [m for m in pipeline.results(flush=True) if isinstance(m, DepthMap)]
    cpu_ms = round(1e3 * (time.process_time() - cpu), 3)
    spent = [depth_map.milliseconds["total"] for depth_map in found]
    row = {"object": scan.name, "events": len(piece.events), "cpu_ms": cpu_ms}
    return [row | time_columns(spent) | {"spent_ms": sum(spent)}]
