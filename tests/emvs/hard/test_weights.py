"""Weights of bma that don't sum to one, are zero, or meet pixels that some views don't have."""

import numpy as np
import pytest

from emvs.hard import world
from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap

VIEWS = (0.0, 0.5, 1.0)
PAPERS = (0.445, 0.333, 0.222)


@pytest.fixture(scope="module")
def events() -> EventArray:
    return world.scan()


def first_map(events: EventArray, views: tuple[float, ...], weights: tuple[float, ...]) -> DepthMap:
    # Views that share their votes take planes of their own; here each view has the same.
    found = world.run(
        "bma",
        events,
        world.poses(),
        paper={"reference_views": views, "weights": weights, "plane_rule": "fixed"},
    )
    return world.maps_of(found)[0]


@pytest.mark.parametrize("weights", [(1.0, 1.0, 1.0), PAPERS])
@pytest.mark.parametrize("factor", [7.0, 1e-6])
def test_only_ratios_of_weights_count(
    events: EventArray, weights: tuple[float, ...], factor: float
) -> None:
    plain = first_map(events, VIEWS, weights)
    scaled = first_map(events, VIEWS, tuple(factor * w for w in weights))
    assert plain.points > 50
    np.testing.assert_allclose(scaled.depth, plain.depth, rtol=3e-7)
    np.testing.assert_allclose(scaled.confidence, plain.confidence, rtol=3e-7)


@pytest.mark.parametrize("weights", [(1.0, 1.0, 1.0), PAPERS])
def test_a_pixel_is_the_mean_of_the_views_that_have_it(
    events: EventArray, weights: tuple[float, ...]
) -> None:
    """Each view by itself, then the mean by hand: where one alone has a depth it is that one."""
    alone = np.stack([first_map(events, (view,), (1.0,)).depth for view in VIEWS]).astype(float)
    seen = np.isfinite(alone)
    number = seen.sum(axis=0)
    assert (number == 1).sum() > 10
    assert (number > 1).sum() > 10
    weight = np.array(weights)[:, None, None] * seen
    with np.errstate(invalid="ignore"):
        expected = np.nansum(weight * np.nan_to_num(alone), axis=0) / weight.sum(axis=0)
    fused = first_map(events, VIEWS, weights).depth
    np.testing.assert_allclose(fused, expected, rtol=3e-7)


def test_a_view_of_no_weight_gives_no_depth(events: EventArray) -> None:
    """Not even where it is the only one: no 0/0."""
    middle = first_map(events, (0.5,), (1.0,)).depth
    fused = first_map(events, VIEWS, (0.0, 1.0, 0.0)).depth
    np.testing.assert_array_equal(fused, middle)
