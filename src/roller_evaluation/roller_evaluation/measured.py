"""Figures of many passes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.progress import Tell
from roller_evaluation.bench.scans import scan_settings

from .jobs import Job, do_jobs
from .repeated_passes import Pass, cell_changes, measure_pass, settings_of

#: To be raised when a method or its figures change: what an older form left is measured anew.
_FORM = 2


class Measured:
    """Figures by pass and method."""

    def __init__(self, results: Mapping[Pass, dict[str, Any]]) -> None:
        self._results = dict(results)

    def of(self, asked: Iterable[Pass], method: str, figure: str) -> list[float]:
        """A figure of each pass; those without are left out."""
        found = (self._results[p]["methods"][method].get(figure) for p in asked)
        return [float(value) for value in found if value is not None]

    def mean(self, asked: Iterable[Pass], method: str, figure: str) -> float | None:
        """Mean over passes."""
        values = self.of(asked, method, figure)
        return float(np.mean(values)) if values else None

    def deviation(self, asked: Iterable[Pass], method: str, figure: str) -> float | None:
        """Standard deviation over passes; None of a single one."""
        values = self.of(asked, method, figure)
        return float(np.std(values, ddof=1)) if len(values) > 1 else None

    def whole(self, asked: Pass) -> dict[str, Any]:
        """All figures of a pass."""
        return self._results[asked]

    def as_json(self) -> list[dict[str, Any]]:
        """All figures, in the order of the passes' names."""
        return [self._results[p] for p in sorted(self._results, key=lambda p: p.name)]


def measure(
    wanted: Mapping[Pass, tuple[str, ...]],
    cell: Mapping[str, Any],
    folder: Path,
    jobs: int,
    tell: Tell,
) -> Measured:
    """Measure passes, or take what an earlier run of the same left.

    Parameters
    ----------
    wanted : mapping of Pass
        Methods by pass.
    cell : mapping
        Settings of the virtual cell that differ from the defaults.
    folder : path
        Where each pass's figures are kept.
    jobs : int
        Processes.
    tell : callable
        Told what was done and the share done, 0–1.

    Raises
    ------
    UnwritableOutputError
        If figures can't be kept.
    """
    # The longest first, so that no core waits for one at the end.
    order = sorted(wanted, key=lambda p: (p.whole, -p.speed), reverse=True)
    work = [
        Job(p.name, _asked(p, wanted[p], cell), measure_pass, (p, wanted[p], cell)) for p in order
    ]
    found = do_jobs(work, folder, jobs, tell, _serves)
    return Measured({asked: found[asked.name] for asked in wanted})


def _asked(asked: Pass, methods: Iterable[str], cell: Mapping[str, Any]) -> dict[str, Any]:
    """All that the figures of a pass depend on."""
    settings = scan_settings(asked.scene, asked.speed, cell_changes(asked, cell))
    chosen = {name: settings_of(name).model_dump(mode="json") for name in methods}
    return json.loads(
        json.dumps(
            {
                "form": _FORM,
                "whole": asked.whole,
                "cell": settings.model_dump(mode="json"),
                "methods": chosen,
            }
        )
    )


def _serves(kept: dict[str, Any], asked: dict[str, Any]) -> bool:
    """Whether figures were measured as asked for, of the same methods or of more."""
    same = all(kept[key] == asked[key] for key in ("form", "whole", "cell"))
    return same and all(kept["methods"].get(k) == v for k, v in asked["methods"].items())
