"""A small virtual cell that tests of the evaluation share."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from roller_evaluation import scans
from roller_evaluation.cases import ScanCase
from roller_evaluation.scans import Scan


@pytest.fixture(scope="session", autouse=True)
def simulated_once() -> Iterator[None]:
    """Give a scan that was simulated for one test to the others too."""
    once = cache(scans.simulate)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(scans, "simulate", lambda case, threads=1: once(case))
        yield


@pytest.fixture(scope="session")
def cell() -> dict[str, Any]:
    """A small image over a coarse plate: a second instead of minutes."""
    return {
        "camera": {"width": 320, "height": 96, "focal_px": 533.0},
        "scene": {"step_mm": 0.06},
        "motion": {"hold_s": 0.02},
    }


@pytest.fixture(scope="session")
def stairs(cell: dict[str, Any], simulated_once: None) -> Scan:
    """A scan of the stairs at 0.3 m/s."""
    return scans.simulate(ScanCase("stairs", 0.3, cell=cell))
