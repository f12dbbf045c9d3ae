"""Loops that draw events onto a plane, against their numpy twins."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from roller_calibration import _plane_kernels as kernels


@given(st.integers(0, 2**32 - 1), st.integers(0, 200))
def test_rays_meet_the_plane_where_numpy_has_it(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    rays = np.column_stack([rng.uniform(-0.3, 0.3, (count, 2)), np.ones(count)])
    down = Rotation.from_euler("x", np.pi)
    rotations = (Rotation.from_rotvec(rng.normal(0, 0.05, (count, 3))) * down).as_matrix()
    positions, height = rng.normal(0, 0.01, (count, 3)), -0.045
    turn = Rotation.from_rotvec(rng.normal(0, 0.05, 3)).as_matrix()
    places = np.empty((count, 2))
    kernels._place(rays, rotations, positions, turn, height, 3e-5, places)
    turned = np.einsum("nij,nj->ni", rotations, rays @ turn.T)
    reach = (height - positions[:, 2]) / turned[:, 2]
    met = positions + reach[:, None] * turned
    np.testing.assert_allclose(met[:, 2], height)
    np.testing.assert_allclose(places, met[:, :2] / 3e-5, atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(0, 200))
def test_places_count_in_the_cells_that_numpy_puts_them_in(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    shape, origin = (30, 20), rng.normal(0, 5, 2)
    places = origin + rng.uniform(-5, 35, (count, 2))
    places[rng.random(count) < 0.1] = np.nan
    counts = np.zeros(shape, np.float32)
    inside, *box = kernels._draw(places, origin, counts)
    with np.errstate(invalid="ignore"):
        within = ((places >= origin) & (places < origin + shape)).all(axis=1)
    cell = (places - origin)[within].astype(int)
    expected = np.zeros(shape, np.float32)
    np.add.at(expected, tuple(cell.T), 1)
    np.testing.assert_array_equal(counts, expected)
    assert inside == len(cell)
    if inside:
        assert box == [cell[:, 0].min(), cell[:, 0].max(), cell[:, 1].min(), cell[:, 1].max()]
