"""Scans that go at an angle to base's axes: what was scanned is a rectangle along them."""

from dataclasses import replace

import numpy as np
import pytest

from roller_emvs.patch import Patch
from roller_inspect.height_map import OUTSIDE
from roller_inspect.height_map.scanned import outside_scan, turn_of
from roller_inspect.pieces import Found
from roller_inspect.references import SelfReference
from roller_inspect.surface_inspector import InspectionSettings, SurfaceInspector

from .analytic_surface import dent, flat, scan

LENGTH_M, WIDTH_M = 0.06, 0.018


def turned(patches: list[Patch], turn_deg: float) -> list[Patch]:
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    pose = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return [replace(patch, points=patch.points @ pose) for patch in patches]


def inspect(patches: list[Patch]) -> Found:
    inspector = SurfaceInspector(InspectionSettings.create({}), SelfReference())
    for patch in patches:
        inspector.add(patch)
    return inspector.finish()


@pytest.mark.parametrize("turn_deg", [0.0, 3.0, -6.0, 10.0, 20.0, 44.0, -44.0, 100.0, 190.0])
def test_coverage_and_findings_are_those_of_the_scan_whatever_its_direction(
    turn_deg: float,
) -> None:
    surface = dent((0.03, 0.002), 1.5e-3, 2e-4)
    found = inspect(turned(scan(surface, length_m=LENGTH_M, width_m=WIDTH_M), turn_deg))
    assert found.coverage.unmeasured < 0.03
    assert found.coverage.area_m2 == pytest.approx(LENGTH_M * WIDTH_M, rel=0.04)
    (one,) = found.findings
    assert one.depth_m == pytest.approx(-2e-4, abs=4e-5)


@pytest.mark.parametrize("turn_deg", [0.0, 8.0, 45.0, -45.0, 98.0])
def test_ends_that_came_into_view_too_late_are_outside_whatever_the_direction(
    turn_deg: float,
) -> None:
    random = np.random.default_rng(9)

    def keep(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        full = (x > 0.006) & (x < 0.054)
        return full | (random.random(x.shape) < 0.01)

    found = inspect(turned(scan(flat, length_m=LENGTH_M, width_m=WIDTH_M, keep=keep), turn_deg))
    assert found.coverage.area_m2 == pytest.approx(0.048 * WIDTH_M, rel=0.05)
    assert found.coverage.unmeasured < 0.03
    height_map = found.height_map
    assert height_map is not None
    x, y = np.meshgrid(height_map.x_m, height_map.y_m)
    base = height_map.in_base(x, y, 0.0 * x)
    turn = np.radians(turn_deg)
    along = base[..., 0] * np.cos(turn) + base[..., 1] * np.sin(turn)
    assert (height_map.state[(along < 0.005) | (along > 0.055)] == OUTSIDE).mean() > 0.99


def test_few_points_and_features_do_not_say_where_the_scan_goes() -> None:
    """The rectangle is upright then, from the first to the last row and column."""
    y, x = np.mgrid[:200, :500]
    random = np.random.default_rng(3)
    askew = np.abs(y - 100 - 0.1 * (x - 250)) < 60
    for known, upright in (
        (askew & (random.random(askew.shape) < 0.2), False),
        (np.hypot(x - 250, y - 100) < 80, True),
        (np.abs(y - 100 - 0.2 * (x - 250)) < 15, True),  # a ridge
        (random.random(askew.shape) < 5e-5, True),
        (np.abs(y - 100 - 0.01 * (x - 250)) < 90, True),
        ((x == 30) & (y == 40), True),
    ):
        rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
        rectangle = (y >= rows[0]) & (y <= rows[-1]) & (x >= columns[0]) & (x <= columns[-1])
        inside = ~outside_scan(known, 1e-4)
        assert inside[known].all()
        assert (inside == rectangle).all() == upright
        assert not (inside & ~rectangle).any()
        assert (turn_of(known, 1e-4) == 0.0) == upright
        if not upright:
            assert (inside & ~askew).sum() < 0.03 * askew.sum()
    assert turn_of(np.zeros((3, 3), bool), 1e-4) == 0.0
