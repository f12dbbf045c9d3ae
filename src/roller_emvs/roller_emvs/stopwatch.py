"""Milliseconds by stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up the time spent in named stages, and that of the processor on all threads."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self.cpu_ms: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a stage."""
        start, cpu = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            spent, used = time.perf_counter() - start, time.process_time() - cpu
            self.milliseconds[stage] = self.milliseconds.get(stage, 0.0) + spent * 1e3
            self.cpu_ms[stage] = self.cpu_ms.get(stage, 0.0) + used * 1e3
