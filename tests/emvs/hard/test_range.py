"""Depth at the ends of the range and beyond: found or refused, never a wrong one."""

import numpy as np
import pytest

from emvs.hard import world
from emvs.hard.world import ALL, PAPER
from roller_core.events import EventArray

NEAR_M, FAR_M = 0.043, 0.047


def plate(depth_m: float) -> EventArray:
    return world.scan(depth=world.flat(depth_m))


@pytest.fixture(scope="module")
def usual() -> dict[str, int]:
    """How many points each method finds on a plate in the middle of the range."""
    events = plate(world.MIDDLE_M)
    return {m: len(world.points_of(world.run(m, events, world.poses()))) for m in ALL}


@pytest.mark.parametrize("depth_m", [NEAR_M, FAR_M], ids=["near", "far"])
@pytest.mark.parametrize("method", ALL)
def test_the_first_and_last_plane(usual: dict[str, int], method: str, depth_m: float) -> None:
    """Half of a peak there is out of range, so it may be refused."""
    points = world.points_of(world.run(method, plate(depth_m), world.poses()))
    wrong = np.abs(world.errors_px(points, world.flat(depth_m))) > 2
    assert wrong.sum() <= 0.02 * usual[method]
    assert np.all((points[:, 2] > NEAR_M - 1e-6) & (points[:, 2] < FAR_M + 1e-6))


BEYOND_PX = {"far before": -8.0, "before": -1.5, "behind": 1.5, "far behind": 8.0}


@pytest.mark.parametrize("place", BEYOND_PX)
@pytest.mark.parametrize("method", ALL)
def test_depth_beyond_the_range_is_refused(usual: dict[str, int], method: str, place: str) -> None:
    """1.5 px of parallax beyond, or 8: any depth would be a wrong one."""
    beyond_px = BEYOND_PX[place]
    edge = NEAR_M if beyond_px < 0 else FAR_M
    events = plate(edge + beyond_px * world.pixel_m())
    points = world.points_of(world.run(method, events, world.poses()))
    assert len(points) <= 0.03 * usual[method]


@pytest.mark.parametrize("depths_m", [(0.044, 0.08), (0.03, 0.046), (0.02, 0.1)])
@pytest.mark.parametrize("method", ["focus", "surface"])
def test_a_plate_anywhere_in_a_wide_range(method: str, depths_m: tuple[float, float]) -> None:
    depths = {"depth_min_m": depths_m[0], "depth_max_m": depths_m[1]}
    found = world.run(method, world.scan(), world.poses(), **depths)
    world.assert_right(world.points_of(found))


@pytest.mark.parametrize("middle_m", [0.07, 0.15], ids=["1.6 times", "3.3 times"])
@pytest.mark.parametrize("method", ALL)
def test_a_range_far_behind_the_plate_is_refused_with_the_reason(
    method: str, middle_m: float
) -> None:
    depths = {"depth_min_m": 0.8 * middle_m, "depth_max_m": 1.2 * middle_m}
    found = world.run(method, plate(world.MIDDLE_M), world.poses(), **depths)
    assert not len(world.points_of(found))
    reasons = [one.reason for one in world.refused_of(found) if "slipping" in one.reason]
    assert reasons
    assert all("or the surface lies at 4" in reason for reason in reasons)


@pytest.mark.parametrize("method", PAPER)
def test_more_planes_than_a_byte_counts(method: str) -> None:
    """600 planes: a plane's number that was cut to 8 bits would be wrong by 1 mm and more."""
    found = world.run(method, world.scan(), world.poses(), paper={"planes": 600})
    world.assert_right(world.points_of(found))
