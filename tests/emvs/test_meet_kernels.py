"""Where events meet a surface, against slow forms."""

import numpy as np

from roller_emvs.evidence import _meet_kernels
from roller_emvs.evidence._kernels import CELL_PX
from roller_emvs.evidence.field import ground

HEIGHT, WIDTH = 32, 48


def surface_of_cells() -> np.ndarray:
    cells = np.tile((1e-5 * np.arange(WIDTH // CELL_PX)).astype(np.float32), (HEIGHT // CELL_PX, 1))
    cells[:, -2:] = np.nan
    return cells


def rays_on(
    surface: np.ndarray, x: np.ndarray, y: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Rays that meet a surface, given by pixel, at pixels."""
    slopes = rng.normal(0, 4000, (len(x), 2))
    offset = surface[y, x][:, None]
    return np.column_stack([np.column_stack([x, y]) - slopes * offset, slopes]).astype(np.float32)


def rays_on_cells(
    cells: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays that meet known cells in their middle, so that rounding moves none to the next."""
    x = rng.integers(0, WIDTH // CELL_PX - 2, count) * CELL_PX + 1
    y = rng.integers(0, HEIGHT // CELL_PX, count) * CELL_PX + 1
    pixels = np.repeat(np.repeat(cells, CELL_PX, 0), CELL_PX, 1)
    return rays_on(pixels, x, y, rng), x, y


def test_events_meet_the_cells_they_are_of() -> None:
    rng = np.random.default_rng(3)
    cells = surface_of_cells()
    rays, x, y = rays_on_cells(cells, 400, rng)
    sums = np.zeros((*cells.shape, 3), np.float32)
    flat = np.append(cells, np.float32(np.nan))
    _meet_kernels._meet(
        rays, 10, 390, (0.0, 0.0), flat, np.float32(0), cells.shape[1], sums.reshape(-1)
    )
    count, slope, square = np.moveaxis(sums, -1, 0)
    expected, summed, squared = (np.zeros_like(cells) for _ in range(3))
    np.add.at(expected, (y[10:390] // CELL_PX, x[10:390] // CELL_PX), 1)
    np.add.at(summed, (y[10:390] // CELL_PX, x[10:390] // CELL_PX), rays[10:390, 2])
    np.testing.assert_array_equal(count, expected)
    np.add.at(squared, (y[10:390] // CELL_PX, x[10:390] // CELL_PX), rays[10:390, 2] ** 2)
    np.testing.assert_allclose(slope, summed, rtol=1e-4, atol=1)
    np.testing.assert_allclose(square, squared, rtol=1e-4)


def test_the_plane_to_search_around_is_that_of_the_cell() -> None:
    rng = np.random.default_rng(5)
    cells = surface_of_cells()
    rays, x, y = rays_on_cells(cells, 300, rng)
    plane = np.empty(300, np.int32)
    step = np.float32(1e-5)
    _meet_kernels._plane_near(rays.T.copy(), cells, np.float32(0), step, 12, plane)
    np.testing.assert_array_equal(plane, np.rint(cells[y // CELL_PX, x // CELL_PX] / step))
    # A ray over unknown cells is searched nowhere.
    lost = np.array([[WIDTH - 2, 5, 0, 0]], np.float32)
    _meet_kernels._plane_near(lost.T.copy(), cells, np.float32(0), step, 12, plane[:1])
    assert plane[0] == -1


def test_events_gather_on_the_surface_that_they_meet() -> None:
    rng = np.random.default_rng(3)
    depth = np.tile((1e-5 * np.arange(WIDTH) - 2e-4).astype(np.float32), (HEIGHT, 1))
    depth[:, 38:] = np.nan
    x, y = rng.integers(5, 36, 500), rng.integers(5, 28, 500)
    pixel, counts = ground(rays_on(depth, x, y, rng), depth)
    np.testing.assert_array_equal(pixel, y * WIDTH + x)
    np.testing.assert_array_equal(counts, np.bincount(pixel, minlength=depth.size + 1))


def test_no_event_meets_a_surface_that_is_nowhere() -> None:
    rng = np.random.default_rng(3)
    nowhere = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    rays = rays_on(np.zeros_like(nowhere), *rng.integers(0, 9, (2, 20)), rng)
    pixel, counts = ground(rays, nowhere)
    assert (pixel == nowhere.size).all()
    assert counts[-1] == 20
