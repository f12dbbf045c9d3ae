"""Points that are far from all others: left out and counted, the map as without them."""

from dataclasses import replace

import numpy as np
import pytest

from roller_emvs.patch import Patch
from roller_inspect.height_map import OUTSIDE
from roller_inspect.pieces import Found, Piece, within
from roller_inspect.references import NominalReference
from roller_inspect.surface_inspector import InspectionSettings, SurfaceInspector

from .analytic_surface import dent, flat, scan


def inspect(patches: list[Patch]) -> Found:
    inspector = SurfaceInspector(InspectionSettings.create({}), NominalReference("plane"))
    for patch in patches:
        inspector.add(patch)
    return inspector.finish()


def with_point(patch: Patch, place: tuple[float, float, float]) -> Patch:
    """A patch with one point more."""
    again = {name: np.concatenate([value, value[:1]]) for name, value in vars(patch).items()}
    again["points"][-1] = place
    return Patch(**again)


@pytest.mark.parametrize("number", [0, 1, 4])
@pytest.mark.parametrize("away_m", [1e3, -1e9, 1e200, np.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_point_far_from_all_others_is_left_out_and_counted(
    number: int, away_m: float, axis: int
) -> None:
    """The map spans what lies between: hours and all memory, or a map of a few coarse cells."""
    patches = scan(dent((0.015, 0.001), 1.5e-3, 2e-4))
    place = [0.01, 0.0, 0.0]
    place[axis] = away_m
    stray = list(patches)
    stray[number] = with_point(patches[number], (place[0], place[1], place[2]))
    whole, found = inspect(patches), inspect(stray)
    assert (whole.left_out, found.left_out) == (0, 1)
    assert whole.height_map is not None
    assert found.height_map is not None
    np.testing.assert_array_equal(found.height_map.height_m, whole.height_map.height_m)
    assert [f.depth_m for f in found.findings] == [f.depth_m for f in whole.findings]


@pytest.mark.parametrize("number", [0, 2, 5])
def test_a_patch_far_from_all_others_is_left_out_wherever_it_comes(number: int) -> None:
    patches = scan(flat)
    away = replace(patches[0], **{name: value[:9] for name, value in vars(patches[0]).items()})
    away = replace(away, points=away.points + 700.0)
    found = inspect([*patches[:number], away, *patches[number:]])
    assert found.left_out == 9
    assert found.height_map is not None
    np.testing.assert_array_equal(found.height_map.height_m, inspect(patches).height_map.height_m)


def test_a_part_of_metres_is_one_part_in_patches_or_at_once() -> None:
    patches = scan(flat, length_m=2.2, width_m=4e-3, per_mm2=20.0, block_m=0.02)
    at_once = Patch(
        *(np.concatenate(v) for v in zip(*(vars(p).values() for p in patches), strict=True))
    )
    for given in (patches, [at_once]):
        found = inspect(given)
        assert found.left_out == 0
        assert found.height_map is not None
        assert np.ptp(found.height_map.x_m) == pytest.approx(2.2, abs=0.02)


def test_nothing_of_a_scan_is_within_a_map_that_is_all_outside() -> None:
    height_map = inspect(scan(flat)).height_map
    assert height_map is not None
    outside = replace(height_map, state=np.full(height_map.shape, OUTSIDE, np.uint8))
    assert within([Piece(height_map, height_map.height_m)], outside) == []
