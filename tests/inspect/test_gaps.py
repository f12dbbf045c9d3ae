"""Gaps within what was measured: what may go on in them is never taken for nothing."""

from typing import Any

import numpy as np
import pytest

from roller_core.transforms import F64

from .analytic_surface import Surface, dent, flat, scan
from .inspecting import finished, inspect

MIDDLE = (0.015, 0.0)


def bowl(radius_m: float, depth_m: float) -> Surface:
    """A paraboloid, whose flanks tell less of its depth than those of a smooth dent."""

    def height(x: F64, y: F64) -> F64:
        r = np.hypot(x - MIDDLE[0], y - MIDDLE[1]) / radius_m
        return -depth_m * np.clip(1 - r**2, 0, None)

    return height


def without_middle(surface: Surface, radius_m: float, **recipe: Any) -> Any:
    def seen(x: F64, y: F64) -> F64:
        return np.hypot(x - MIDDLE[0], y - MIDDLE[1]) > radius_m

    return finished(inspect(scan(surface, noise_m=1e-5, keep=seen), **recipe)[1]).judgement


@pytest.mark.parametrize("reference", ["self", "nominal"])
@pytest.mark.parametrize("gap_m", [1.5e-3, 1.75e-3, 1.9e-3])
def test_a_dent_whose_middle_was_not_measured_never_passes(gap_m: float, reference: str) -> None:
    found = without_middle(bowl(2.5e-3, 3e-4), gap_m, reference=reference)
    assert found.verdict == "inconclusive"


def test_it_is_said_where() -> None:
    found = without_middle(bowl(2.5e-3, 3e-4), 1.75e-3)
    assert not found.findings
    assert "beside a gap at (1" in found.reason
    assert "how deep it goes on there wasn't measured" in found.reason


@pytest.mark.parametrize("gap_m", [6e-4, 1.5e-3])
def test_a_gap_in_what_is_flat_hides_nothing(gap_m: float) -> None:
    assert without_middle(flat, gap_m).verdict == "conform"


def test_a_narrow_gap_hides_little() -> None:
    found = without_middle(bowl(2.5e-3, 3e-4), 4e-4, tolerances=[{"depth_m": 4.5e-4}])
    assert found.verdict == "conform", found.reason
    assert found.coverage.unmeasured > 0


def test_what_may_be_far_deeper_than_its_rim_may_have_a_gap() -> None:
    found = without_middle(bowl(2.5e-3, 2e-4), 1.6e-3, tolerances=[{"depth_m": 4e-4}])
    assert found.verdict == "conform", found.reason


def test_what_was_measured_whole_beside_a_gap_is_judged_by_itself() -> None:
    beside = dent((0.0185, 0.0), 1e-3, 2e-4)
    found = without_middle(beside, 1.2e-3, tolerances=[{"depth_m": 3e-4}])
    assert [j.verdict for j in found.findings] == ["conform"]
    assert found.verdict == "conform", found.reason


def test_what_the_recipe_leaves_out_may_have_gaps() -> None:
    regions = {"hole": {"circle_m": [*MIDDLE, 4e-3]}}
    surface = bowl(2.5e-3, 3e-4)
    assert without_middle(surface, 1.6e-3, regions=regions, exclude=["hole"]).verdict == "conform"


def measured(surface: Surface, gap_m: float) -> dict[str, Any]:
    regions = {"spot": {"circle_m": [*MIDDLE, 4e-3]}, "around": {"circle_m": [*MIDDLE, 5.5e-3]}}
    measures = [
        {"name": tool, "tool": tool, "of": "spot", "datum": "around"}
        for tool in ("depth", "volume", "area", "diameter")
    ]
    found = without_middle(surface, gap_m, regions=regions, measures=measures)
    return {figure.name: figure for figure in found.figures}


def test_a_depth_that_is_deepest_beside_a_gap_is_none() -> None:
    figures = measured(bowl(2.5e-3, 3e-4), 1.2e-3)
    assert len(figures) == 4
    for figure in figures.values():
        assert figure.value is None
        assert "beside a gap" in figure.reason


def test_a_depth_beside_which_a_gap_lies_is_measured() -> None:
    aside = dent((0.0175, 0.0), 1.5e-3, 3e-4)
    depth = measured(aside, 8e-4)["depth"]
    assert depth.value == pytest.approx(-3e-4, abs=depth.uncertainty)
