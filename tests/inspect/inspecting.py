"""Points of a part through the stage that inspects them."""

from typing import Any

from roller_core.outputs import Cloud, Output, Result
from roller_emvs.patch import SURFACE_FIELDS, Patch
from roller_inspect.inspect_stage import InspectParameters, InspectStage
from roller_inspect.judgement import Inspected
from roller_inspect.recipe import Recipe

from .analytic_surface import dent

PLANE: dict[str, Any] = {"reference": "nominal", "least_coverage": 0.5}


def clouds(patches: list[Patch], t_ns: int = 0) -> list[Output]:
    return [
        Output(
            "roller/surface/points", t_ns + k * 10**8, "base", Cloud(p.columns(), SURFACE_FIELDS)
        )
        for k, p in enumerate(patches)
    ]


def inspect(patches: list[Patch], **recipe: Any) -> tuple[InspectStage, list[Result]]:
    """A part through the stage, asked for results after every cloud."""
    settings = InspectParameters.create({"part": "P-17"})
    stage = InspectStage(settings, Recipe.create(PLANE | recipe))
    results: list[Result] = []
    for output in clouds(patches):
        stage.take_output(output)
        results += stage.results()
    return stage, results + list(stage.results(flush=True))


def finished(results: list[Result]) -> Inspected:
    (part,) = [r.found for r in results if isinstance(r.found, Inspected)]
    return part


HOLE = dent((0.008, 0.0), 1.2e-3, 3e-4)
SMALL: dict[str, Any] = {"length_m": 0.016, "width_m": 0.006}
