"""Cost as the work grows: events a window, planes, image size, threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from roller_core.events import EventArray
from roller_emvs.depth_settings import DepthSettings

from .cases import depth_settings
from .measure import time_figures, window_ms
from .options import BenchOptions
from .resampling import Piece, densest_piece, resample, scaled
from .scans import Scan

METHODS = ("focus", "bma")


def run_growth(
    scan: Scan, options: BenchOptions, tell: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Time one real window while one quantity grows.

    Parameters
    ----------
    scan : Scan
        Its densest window is taken.
    options : BenchOptions
        Steps.
    tell : callable
        Told what is being measured.

    Returns
    -------
    dict
        By quantity: rows with `method`, its value and times.
    """
    piece = densest_piece(scan, options.fixed_window_s, options.fixed_events)
    full = densest_piece(scan, options.fixed_window_s, max(options.growth_events))
    out: dict[str, Any] = {
        "base": {
            "object": scan.name,
            "speed": scan.speed,
            "window_ms": options.fixed_window_s * 1e3,
            "events": options.fixed_events,
            "image": [scan.camera.width, scan.camera.height],
        },
        "events": [],
        "planes": [],
        "image": [],
        "threads": [],
    }

    jobs: list[_Job] = []

    def add(
        rows: str, value: Any, method: str, events: EventArray, where: Scan, **changes: Any
    ) -> None:
        settings = depth_settings(method, window="all", **changes)
        jobs.append(_Job(rows, value, method, settings, events, where))

    for method in METHODS:
        for count in options.growth_events:
            add("events", count, method, _drawn(full, count), scan)
        for scale in options.growth_scales:
            events, camera = scaled(piece.events, scan.camera, scale)
            where = replace(scan, camera=camera)
            add("image", [camera.width, camera.height], method, events, where)
        for threads in options.growth_threads:
            add("threads", threads, method, piece.events, scan, threads=threads)
    for planes in options.growth_planes:
        # `focus` takes as many planes as the parallax asks for.
        add(
            "planes",
            planes,
            "bma",
            piece.events,
            scan,
            **{"paper.plane_rule": "fixed", "paper.planes": planes},
        )
    # Round by round, as the cases are; the first round compiles and doesn't count.
    for number in range(max(options.repeats, 1) + 1):
        for job in jobs:
            tell(f"growth: {job.method}, {job.rows} {job.value}")
            spent = window_ms(job.settings, job.events, job.scan)
            if number and spent is not None:
                job.runs.append([spent])
    for job in jobs:
        row = {"method": job.method, job.rows: job.value, **time_figures(job.runs)}
        out[job.rows].append(row)
    return out


@dataclass(frozen=True)
class _Job:
    rows: str
    value: Any
    method: str
    settings: DepthSettings
    events: EventArray
    scan: Scan
    runs: list[list[float]] = field(default_factory=list)


def _drawn(piece: Piece, count: int) -> EventArray:
    """Fewer events of a window, with its first and last one."""
    drawn = resample(piece.events, count)
    t_ns = drawn.t_ns.copy()
    t_ns[0], t_ns[-1] = piece.start_ns, piece.end_ns - 1
    return drawn.with_times(t_ns)
