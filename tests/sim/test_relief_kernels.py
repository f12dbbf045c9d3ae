"""Loops over height maps, against their numpy twins."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roller_sim import _relief_kernels as kernels
from roller_sim.cell_settings import LightSettings
from roller_sim.optics import SurfaceMaps
from roller_sim.relief import HeightMap

SEEDS = st.integers(0, 2**32 - 1)


def random_map(rng: np.random.Generator) -> HeightMap:
    height = rng.normal(0, 1e-4, rng.integers(1, 9, 2)).astype(np.float32)
    return HeightMap(height, *rng.normal(0, 1e-2, 2), step=float(rng.uniform(1e-5, 1e-4)))


@given(SEEDS, st.integers(0, 60))
def test_heights_are_those_that_numpy_interpolates(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    skin = random_map(rng)
    ny, nx = skin.height.shape
    # A third of them lie beyond the grid.
    px = rng.uniform(-0.25 * nx, 1.25 * nx, count)
    py = rng.uniform(-0.25 * ny, 1.25 * ny, count)
    found = skin.sample(skin.x0 + px * skin.step, skin.y0 + py * skin.step)
    px, py = np.clip(px, 0, nx - 1), np.clip(py, 0, ny - 1)
    column, row = px.astype(int), py.astype(int)
    fx, fy = px - column, py - row
    height = np.pad(skin.height, (0, 1), mode="edge")
    low = height[row, column] * (1 - fx) + height[row, column + 1] * fx
    high = height[row + 1, column] * (1 - fx) + height[row + 1, column + 1] * fx
    np.testing.assert_allclose(found, low * (1 - fy) + high * fy, atol=1e-9)


def test_heights_have_the_shape_of_their_places() -> None:
    skin = random_map(np.random.default_rng(0))
    x, y = np.linspace(0, 1e-2, 5), np.linspace(0, 1e-2, 3)[:, None]
    found = skin.sample(x, y)
    assert found.shape == (3, 5)
    assert found[2, 3] == skin.sample(x[3], y[2, 0])
    assert skin.sample(0.0, 0.0).shape == ()
    assert np.isnan(skin.sample([np.nan, 0.0], [0.0, np.nan])).all()


@given(SEEDS)
def test_slopes_are_those_of_the_neighbours(seed: int) -> None:
    skin = random_map(np.random.default_rng(seed))
    values = SurfaceMaps.build(skin, LightSettings(speckle=0.0), 0).values
    height = skin.height * np.float32(1e3)
    np.testing.assert_array_equal(values[..., 0], height)
    twice = np.float32(2e3 * skin.step)
    x, y = np.zeros((2, *height.shape), np.float32)
    x[:, 1:-1] = (height[:, 2:] - height[:, :-2]) / twice
    y[1:-1] = (height[2:] - height[:-2]) / twice
    np.testing.assert_allclose(values[..., 1], x, rtol=1e-5)
    np.testing.assert_allclose(values[..., 2], y, rtol=1e-5)
    assert not values[..., 3].any()


@pytest.mark.parametrize("shape", [(2, 2), (3, 2), (2, 3)])
def test_small_maps_have_no_slopes_beyond_their_border(shape: tuple[int, int]) -> None:
    values = np.zeros((*shape, 4), np.float32)
    height = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    kernels._fill_slopes(height, np.float32(2), values)
    assert values[..., 1].any() == (shape[1] > 2)
    assert values[..., 2].any() == (shape[0] > 2)
