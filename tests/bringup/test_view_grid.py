"""The map of the operator's page: cells in tiles, of bounded size."""

from collections import defaultdict

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bringup.view_results import cells_of
from roller_bringup.view.grid import CONTINUED, MEASURED, UNMEASURED, Grid
from roller_bringup.view.hull import cells_in_hull
from roller_bringup.view.raster import rasters

points = st.lists(
    st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-1e-3, 1e-3)), max_size=40
)


@settings(max_examples=25)
@given(points, st.integers(1, 5))
def test_cells_hold_the_mean_of_their_points(found, parts):
    grid, truth = Grid(1e-3), defaultdict(list)
    for k in range(parts):
        x, y, z = np.array(found[k::parts], np.float64).reshape(-1, 3).T
        grid.add(x, y, {"height": z.astype(np.float32)})
        for i, j, v in zip(np.floor(x / 1e-3), np.floor(y / 1e-3), z, strict=True):
            truth[i, j].append(v)
    cells = {(k[0], k[1]): row for k, row in cells_of(grid).items() if row[0] == MEASURED}
    assert cells.keys() == truth.keys()
    for key, values in truth.items():
        assert cells[key][1] == pytest.approx(np.mean(values), abs=1e-8)


def test_larger_cells_hold_the_mean_of_the_smaller_and_memory_is_bounded():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 0.5, 20_000), rng.uniform(0, 0.01, 20_000)
    z = rng.normal(0, 1e-4, 20_000).astype(np.float32)
    small, large = Grid(1e-4, most_tiles=20), Grid(1e-3)
    epoch = small.epoch
    small.add(x, y, {"height": z})
    assert len(small.tiles) <= 20
    assert small.epoch != epoch
    large = Grid(small.cell_m)
    large.add(x, y, {"height": z})
    one, other = cells_of(small), cells_of(large)
    measured = {k: v[1] for k, v in one.items() if v[0] == MEASURED}
    assert measured.keys() == {k for k, v in other.items() if v[0] == MEASURED}
    assert all(v == pytest.approx(other[k][1], abs=1e-8) for k, v in measured.items())


def test_what_lies_between_points_that_came_together_is_looked_at():
    grid = Grid(1e-3)
    corners = np.array([[0, 0], [0.01, 0], [0, 0.01], [0.01, 0.01]]) + 5e-4
    grid.add(*corners.T, {"height": np.zeros(4, np.float32)})
    states = {k: v[0] for k, v in cells_of(grid).items()}
    assert len(states) == 11 * 11
    assert sorted(states.values())[-4:] == [MEASURED] * 4
    assert states[5, 5] == UNMEASURED
    assert grid.covered() == pytest.approx(4 / 121)
    grid.add(*corners[:1].T + 0.02, {"height": np.zeros(1, np.float32)})
    assert cells_of(grid)[15, 15][0] == UNMEASURED  # a stretch between without a point
    grid.add(*corners[:1].T + 0.2, {"height": np.zeros(1, np.float32)})
    assert (100, 100) not in cells_of(grid)
    grid.add(*corners[:1].T, {"deviation": np.ones(1, np.float32)}, CONTINUED)
    assert cells_of(grid)[0, 0][0] == MEASURED
    assert grid.tiles[0, 0].layers["deviation"][0, 0] == 1


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=12))
def test_cells_between_others_are_those_of_their_convexcells_in_hull(cells):
    i, j = np.array(cells).T
    i, j = i - i.min(), j - j.min()
    inside = cells_in_hull(i, j)
    corners = cv2.convexHull(np.column_stack([i, j]).astype(np.int32))
    for y, x in np.ndindex(inside.shape):
        assert inside[y, x] == (cv2.pointPolygonTest(corners, (float(x), float(y)), False) >= 0)


def test_layers_have_one_order_whichever_came_first():
    grid = Grid(1e-3)
    for name in ("deviation", "height"):
        grid.add(*np.full((3, 1), 5e-4)[:2], {name: np.ones(1, np.float32)})
    assert grid.layers == ["height", "deviation"]


def test_of_several_states_a_cell_has_the_best():
    grid = Grid(1e-3)
    states = np.array([MEASURED, CONTINUED, CONTINUED], np.uint8)
    x, deviation = np.array([0.5, 0.6, 1.5]) * 1e-3, np.array([1, 3, 5], np.float32)
    grid.add(x, np.full(3, 5e-4), {"deviation": deviation}, states, looked_at=False)
    cells = cells_of(grid, "deviation")
    assert cells == {(0, 0): (MEASURED, 2.0), (1, 0): (CONTINUED, 5.0)}


@given(st.lists(st.tuples(st.integers(0, 900), st.integers(-900, 0)), min_size=1, max_size=30))
def test_points_far_apart_are_summed_up_tile_by_tile(cells):
    i, j = np.array(cells).T
    values, states = np.arange(1.0, len(i) + 1), np.arange(len(i)) % 2 + np.uint8(CONTINUED)
    sums, best, pieces = defaultdict(float), defaultdict(int), 0
    for raster in rasters(i, j, {"v": values}, states.astype(np.uint8), 64):
        pieces += 1
        assert raster.count.size <= 1 << 17
        for y, x in zip(*np.nonzero(raster.count), strict=True):
            sums[raster.x0 + x, raster.y0 + y] += raster.sums["v"][y, x]
            best[raster.x0 + x, raster.y0 + y] = raster.state[y, x]
    assert pieces <= len(set(zip(i // 64, j // 64, strict=True)))
    for cell in set(cells):
        here = (i == cell[0]) & (j == cell[1])
        assert sums[cell] == values[here].sum()
        assert best[cell] == states[here].max()
    assert sums.keys() == set(cells)
