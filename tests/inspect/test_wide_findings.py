"""Hollows and rises as wide as the blocks that noise is told from: one finding each."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from roller_core.transforms import F64
from roller_inspect.judgement import Judged

from .analytic_surface import Surface, dent, scan
from .inspecting import finished, inspect

MIDDLE = (0.018, 0.0)


def flat_bottomed(at: tuple[float, float], radius_m: float, depth_m: float) -> Surface:
    """A hollow (rise, where the depth is negative) with a wall 0.4 mm wide."""

    def height(x: F64, y: F64) -> F64:
        r = np.hypot(x - at[0], y - at[1])
        return -depth_m * np.clip((radius_m - r) / 4e-4 + 0.5, 0, 1)

    return height


def findings(surface: Surface, reference: str, seed: int = 0) -> Sequence[Judged]:
    recipe: dict[str, Any] = {"reference": reference, "tolerances": [{"depth_m": 3e-3}]}
    points = scan(surface, length_m=0.036, width_m=0.024, per_mm2=50.0, seed=seed)
    return finished(inspect(points, **recipe)[1]).judgement.findings


@pytest.mark.parametrize("reference", ["self", "nominal", "nominal:polynomial2"])
@pytest.mark.parametrize(
    ("radius_m", "depth_m", "seed"),
    [(4.5e-3, 8e-5, 1), (5e-3, 8e-5, 0), (5e-3, 3e-4, 1), (5e-3, -3e-4, 0), (6e-3, 3e-4, 0)],
)
def test_a_hollow_with_a_flat_bottom_is_one(
    radius_m: float, depth_m: float, seed: int, reference: str
) -> None:
    (judged,) = findings(flat_bottomed(MIDDLE, radius_m, depth_m), reference, seed)
    found = judged.finding
    u = found.uncertainty
    assert found.depth_m == pytest.approx(-depth_m, abs=u.depth_m)
    assert found.length_m == pytest.approx(2 * radius_m, abs=u.length_m)
    assert found.width_m == pytest.approx(2 * radius_m, abs=u.width_m)
    assert found.area_m2 == pytest.approx(math.pi * radius_m**2, rel=0.08)
    assert np.hypot(*(found.center_m[:2] - MIDDLE)) < 1e-4


@pytest.mark.parametrize("reference", ["self", "nominal"])
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("apart_m", [6e-4, 1e-3, 2e-3])
def test_two_that_lie_apart_stay_two(apart_m: float, seed: int, reference: str) -> None:
    def two(x: F64, y: F64) -> F64:
        aside = 3e-3 + apart_m / 2
        one, other = (
            flat_bottomed((MIDDLE[0] + s * aside, 0.0), 3e-3, 2e-4)(x, y) for s in (-1, 1)
        )
        return np.minimum(one, other)

    assert len(findings(two, reference, seed)) == 2


@pytest.mark.parametrize("reference", ["self", "nominal"])
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(("radius_m", "depth_m"), [(4e-3, 1e-4), (5e-3, 1e-4), (7e-3, 3e-4)])
def test_a_bowl_and_its_flank_are_one(
    radius_m: float, depth_m: float, seed: int, reference: str
) -> None:
    points = scan(dent((0.02, 0.0), radius_m, depth_m), length_m=0.04, width_m=0.024, seed=seed)
    (judged,) = finished(inspect(points, reference=reference)[1]).judgement.findings
    found = judged.finding
    # Its outline runs where a fifth of its depth is reached.
    fifth_m = radius_m * math.sqrt(1 - math.sqrt(0.2))
    assert found.depth_m == pytest.approx(-depth_m, abs=found.uncertainty.depth_m)
    assert found.length_m == pytest.approx(2 * fifth_m, abs=found.uncertainty.length_m)
