"""Another part in the same place, and further passes over one."""

import numpy as np
import pytest

from roller_inspect.inspect_stage import InspectParameters, InspectStage
from roller_inspect.judgement import Inspected
from roller_inspect.recipe import Recipe
from roller_inspect.revisits import Revisits

from .analytic_surface import dent, flat, scan
from .inspecting import PLANE, SMALL, clouds

S = 10**9


def strip(x_m: float, y_m: float) -> np.ndarray:
    """A cloud of 20 x 10 mm that begins at a place."""
    points = np.random.default_rng(1).uniform(0, 1, (20_000, 3)) * [0.02, 0.01, 1e-4]
    return np.asarray(points + [x_m, y_m, 0.0])


@pytest.mark.parametrize(
    ("x_m", "y_m", "after_s", "another"),
    [
        (0.0, 0.0, 3.0, True),
        (0.003, 0.002, 3.0, True),  # not laid down in quite the same place
        (0.0, 0.0, 1.0, False),  # to and fro
        (0.0, 0.009, 60.0, False),  # the strip beside it
        (0.015, 0.0, 60.0, False),  # slowly on
    ],
)
def test_what_is_another_part(x_m: float, y_m: float, after_s: float, another: bool) -> None:
    revisits = Revisits(2.0)
    for _ in range(2):
        assert not revisits.again(strip(0.0, 0.0), 5 * S)
        assert revisits.again(strip(x_m, y_m), round((5 + after_s) * S)) is another
        revisits.begin()


def test_a_bad_part_is_not_hidden_by_good_ones_after_it() -> None:
    """Three good parts laid in the same place would level its dent."""
    settings = InspectParameters.create({"part": "P", "idle_flush_s": 2.0})
    stage = InspectStage(settings, Recipe.create(PLANE | {"tolerances": [{"depth_m": 1.5e-4}]}))
    for k, surface in enumerate((dent((0.008, 0.0), 1.2e-3, 3e-4), flat, flat, flat)):
        for output in clouds(scan(surface, seed=k, **SMALL), t_ns=10 * k * S):
            stage.take_output(output)
    parts = [r.found for r in stage.results(flush=True) if isinstance(r.found, Inspected)]
    assert [p.judgement.verdict for p in parts] == ["nonconform", "conform", "conform", "conform"]
