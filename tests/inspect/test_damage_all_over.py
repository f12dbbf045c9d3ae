"""A surface that is damaged all over: nothing stands out, yet it never passes."""

from dataclasses import replace

import numpy as np
import pytest

from roller_core.transforms import F64
from roller_inspect.form import damaged_all_over
from roller_inspect.recipe import Recipe

from .analytic_surface import Surface, dent, flat, scan
from .inspecting import finished, inspect

REFERENCES = ("self", "nominal")


def hail(count: int) -> Surface:
    """Dents of 250 µm, anywhere."""
    at = np.random.default_rng(1).uniform((0, -6e-3), (0.03, 6e-3), (count, 2))
    dents = [dent((x, y), 1e-3, 2.5e-4) for x, y in at]

    def height(x: F64, y: F64) -> F64:
        return np.min([one(x, y) for one in dents], axis=0)

    return height


def ripple(x: F64, _: F64) -> F64:
    """200 µm up and down, every 2 mm."""
    return 2e-4 * np.sin(2 * np.pi * x / 2e-3)


def fine_ripple(x: F64, _: F64) -> F64:
    """150 µm up and down, every 0.8 mm."""
    return 1.5e-4 * np.sin(2 * np.pi * x / 8e-4)


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize(
    "surface", [hail(150), hail(250), ripple, fine_ripple], ids=["150", "250", "ripple", "fine"]
)
def test_what_is_damaged_all_over_never_passes(surface: Surface, reference: str) -> None:
    part = finished(inspect(scan(surface, noise_m=1e-5), reference=reference)[1])
    assert part.judgement.verdict != "conform"


def test_it_is_said_where_nothing_stands_out() -> None:
    part = finished(inspect(scan(ripple, noise_m=1e-5), reference="self")[1])
    assert part.judgement.verdict == "inconclusive"
    assert not part.judgement.findings
    assert "more than 100 µm off" in part.judgement.reason
    assert "damaged all over" in part.judgement.reason


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("noise_m", [1e-5, 3.5e-5])
def test_noise_and_a_fine_texture_are_no_damage(reference: str, noise_m: float) -> None:
    for surface in (flat, lambda x, y: ripple(x, y) / 4):
        part = finished(inspect(scan(surface, noise_m=noise_m), reference=reference)[1])
        assert part.judgement.verdict == "conform", part.judgement.reason


def test_what_is_allowed_less_than_a_scan_errs_by_is_not_held_against_it() -> None:
    tolerances = [{"depth_m": 3e-5}]
    part = finished(inspect(scan(flat, noise_m=3e-5), tolerances=tolerances)[1])
    assert part.judgement.verdict == "conform", part.judgement.reason


def test_what_is_allowed_is_no_damage() -> None:
    tolerances = [{"depth_m": 3e-4}]
    part = finished(inspect(scan(ripple), reference="self", tolerances=tolerances)[1])
    assert part.judgement.verdict == "conform", part.judgement.reason


def test_findings_that_are_judged_by_their_length_alone_are_no_damage_all_over() -> None:
    """As many as fill more of the area than may lie off, each found and each allowed."""
    places = [(x, y) for x in np.arange(2.5e-3, 0.03, 5e-3) for y in (-2e-3, 2e-3)]
    dents = [dent(at, 1.2e-3, 4e-4) for at in places]

    def surface(x: F64, y: F64) -> F64:
        return np.min([one(x, y) for one in dents], axis=0)

    allowed = [{"length_m": 6e-3}]
    part = finished(
        inspect(scan(surface, noise_m=1e-5), reference="nominal", tolerances=allowed)[1]
    )
    assert len(part.judgement.findings) >= len(dents)
    assert part.judgement.verdict == "conform", part.judgement.reason
    # The same without them on the list.

    recipe = Recipe.create({"reference": "nominal", "tolerances": allowed})
    assert damaged_all_over(recipe, replace(part.found, findings=()))
