"""A small virtual cell that tests of the evaluation share."""

from __future__ import annotations

from typing import Any

import pytest

from roller_evaluation.cases import ScanCase
from roller_evaluation.scans import Scan, simulate


@pytest.fixture(scope="session")
def cell() -> dict[str, Any]:
    """A small image over a coarse plate: a second instead of minutes."""
    return {
        "camera": {"width": 320, "height": 96, "focal_px": 533.0},
        "scene": {"step_mm": 0.06},
        "motion": {"hold_s": 0.02},
    }


@pytest.fixture(scope="session")
def stairs(cell: dict[str, Any]) -> Scan:
    """A scan of the stairs at 0.3 m/s."""
    return simulate(ScanCase("stairs", 0.3, cell=cell))
