"""The whole scan thinned to a bounded size."""

from pathlib import Path

import numpy as np
import pytest

from roller_core.outputs import SURFACE_MAP
from roller_emvs.patch import Patch
from roller_emvs.ply import read_ply
from roller_emvs.surface_map import EmptyMapError, MapKeeper, MapSettings, SurfaceMap

RNG = np.random.default_rng(3)


def patches(count: int, points: int = 400) -> list[Patch]:
    """A sensor that rolls along x, with points of many equal confidences."""
    made = []
    for k in range(count):
        at = RNG.uniform(0, 0.01, (points, 3)) + [0.003 * k, 5.0, -2.0]
        sure = RNG.integers(1, 5, points).astype(np.float32) / 4
        made.append(Patch(at, at[:, 2].astype(np.float32), sure, 1e-5 / sure))
    return made


def slow_map(given: list[Patch], max_points: int, voxel_m: float) -> tuple[np.ndarray, float]:
    """The same in plain words: coarser and coarser voxels until the best points are few enough."""
    columns = np.concatenate([np.column_stack([p.points, *p.properties()]) for p in given])
    cells = np.floor((columns[:, :3] - columns[0, :3]) / voxel_m).astype(int)
    while True:
        best: dict[tuple[int, ...], np.ndarray] = {}
        for cell, row in zip(map(tuple, cells), columns, strict=True):
            if cell not in best or row[4] > best[cell][4]:
                best[cell] = row
        if len(best) <= max_points:
            return np.array([best[cell] for cell in sorted(best)]), voxel_m
        cells, voxel_m = cells // 2, voxel_m * 2


@pytest.mark.parametrize("max_points", [200, 5000])
def test_it_holds_the_surest_point_of_each_voxel_whenever_it_is_looked_at(max_points: int) -> None:
    given = patches(8)
    once, often = SurfaceMap(max_points, 4e-4), SurfaceMap(max_points, 4e-4)
    for patch in given:
        once.add(patch)
        often.add(patch)
        assert len(often.patch()) <= max_points
    expected, voxel_m = slow_map(given, max_points, 4e-4)
    assert (voxel_m > 4e-4) == (max_points == 200)
    for found in (once, often):
        assert np.array_equal(found.patch().points, expected[:, :3])
        assert found.voxel_m == voxel_m
        assert np.array_equal(found.patch().confidence, expected[:, 4].astype(np.float32))
        assert np.array_equal(found.patch().sigma, expected[:, 5].astype(np.float32))


def test_points_that_are_not_finite_or_far_beyond_reach_are_left_out() -> None:
    points = np.array([[0.0, 0, 0], [np.nan, 0, 0], [1e6, 0, 0]])
    found = SurfaceMap(100, 1e-4)
    found.add(Patch(points, *np.ones((3, 3), np.float32)))
    assert len(found.patch()) == 1


def test_it_goes_out_at_most_once_a_second_and_at_the_end_and_when_cleared() -> None:
    keeper = MapKeeper(MapSettings.create({}), "base")
    sizes = []
    for k, patch in enumerate(patches(11, points=10)):
        keeper.add(patch, int(k * 0.25e9))
        sizes.append([len(r.outputs[0].data.columns) for r in keeper.results(flush=False)])
    assert [k for k, found in enumerate(sizes) if found] == [0, 4, 8]
    (last,) = keeper.results(flush=True)
    (output,) = last.outputs
    assert (output.topic, output.frame_id, output.t_ns) == (SURFACE_MAP, "base", 2_500_000_000)
    assert output.data.names == ("x", "y", "z", "height", "confidence", "sigma")
    assert list(keeper.results(flush=True)) == []
    keeper.clear()
    (empty,) = keeper.results(flush=False)
    assert empty.outputs[0].data.columns.shape == (0, 6)
    keeper.clear()
    assert list(keeper.results(flush=True)) == []


def test_it_is_saved_without_replacing_a_file(tmp_path: Path) -> None:
    keeper = MapKeeper(MapSettings.create({"folder": str(tmp_path / "maps")}), "base")
    with pytest.raises(EmptyMapError, match="empty"):
        keeper.save()
    (patch,) = patches(1)
    keeper.add(patch, 0)
    paths = [Path(keeper.save()) for _ in range(3)]
    assert len(set(paths)) == 3
    assert sorted(paths) == sorted((tmp_path / "maps").iterdir())
    (result,) = keeper.results(flush=True)
    for path in paths:
        saved = np.stack(list(read_ply(path).values()), axis=1)
        assert np.array_equal(saved.astype(np.float32), result.outputs[0].data.columns)
