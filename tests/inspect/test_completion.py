"""The surface between measured cells."""

import itertools

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_inspect.height_map import _kernels, _multigrid
from roller_inspect.height_map.cells import bin_points
from roller_inspect.height_map.completion import at_middles, complete_surface
from roller_inspect.height_map.gaps import hold_gaps
from roller_inspect.height_map.height_map import F32
from roller_inspect.height_map.nearest import distance_to, nearest_known
from roller_inspect.height_map.scatter import scatter_of

from .analytic_surface import errors


def matrix_of(pull: F64, bend: F64, tie_x: F64, tie_y: F64) -> F64:
    """The kernels' matrix, one difference at a time."""
    ny, nx = pull.shape
    out = np.diag(pull.ravel())

    def add(weight: float, cells: dict[tuple[int, int], float]) -> None:
        row = np.zeros((ny, nx))
        for cell, value in cells.items():
            row[cell] = value
        out[:] += weight * np.outer(row, row)

    for i in range(ny):
        for j in range(nx):
            if 0 < j < nx - 1:
                add(bend[i, j], {(i, j - 1): 1, (i, j): -2, (i, j + 1): 1})
            if 0 < i < ny - 1:
                add(bend[i, j], {(i - 1, j): 1, (i, j): -2, (i + 1, j): 1})
            if i < ny - 1 and j < nx - 1:
                mixed = {(i, j): 1, (i, j + 1): -1, (i + 1, j): -1, (i + 1, j + 1): 1}
                add(2 * bend[i, j], mixed)
            if j < nx - 1:
                add(tie_x[i, j], {(i, j): -1, (i, j + 1): 1})
            if i < ny - 1:
                add(tie_y[i, j], {(i, j): -1, (i + 1, j): 1})
    return out


def parts_of(ny: int, nx: int, random: np.random.Generator, known: float = 0.5) -> list[F32]:
    """What the solver's matrix is made of: pull, bend and ties along x and y."""
    pull = random.uniform(0, 1, (ny, nx)) * (random.random((ny, nx)) < known)
    pull[0, 0] = 1
    parts = [pull, random.uniform(0.1, 5, (ny, nx))]
    parts += [random.uniform(0.01, 1, shape) for shape in ((ny, nx - 1), (ny - 1, nx))]
    return [part.astype(np.float32) for part in parts]


def cells(ny: int, nx: int) -> tuple[F32, ...]:
    return tuple(np.zeros((-(-ny // 2**k), -(-nx // 2**k)), np.float32) for k in range(8))


def solver(parts: list[F32]) -> tuple[tuple[tuple[F32, ...], ...], list[tuple[F32, ...]], F32]:
    """The solver's levels, of which the first has the parts, and its scratch."""
    ny, nx = parts[0].shape
    ties = [part[:, 1:].copy() for part in cells(ny, nx)], [p[1:].copy() for p in cells(ny, nx)]
    levels = tuple(zip(cells(ny, nx), cells(ny, nx), *ties, cells(ny, nx), strict=True))
    for level, part in zip(levels[0], parts, strict=False):
        level[:] = part
    return levels, [cells(ny, nx) for _ in range(4)], np.empty((3, nx + 2), np.float32)


def spread_of(n: int) -> F64:
    """Heights of n cells from those of half as many, linear between their centres."""
    out = np.zeros((n, -(-n // 2)))
    for i in range(n):
        beside = min(max(i // 2 + (1 if i % 2 else -1), 0), out.shape[1] - 1)
        out[i, i // 2] += 0.75
        out[i, beside] += 0.25
    return out


def cycle_of(levels: tuple[tuple[F32, ...], ...], right: F64) -> F64:
    """One V-cycle, with matrices."""
    matrix = matrix_of(*(part.astype(float) for part in levels[0][:4]))
    scale = 1 / np.diag(matrix)

    def smooth(x: F64, steps: int, least: float) -> F64:
        # Of Chebyshev's iteration the error's polynomial, by its roots.
        low = 4 / least
        for k in range(steps):
            root = (4 + low) / 2 + (4 - low) / 2 * np.cos(np.pi * (k + 0.5) / steps)
            x = x + scale * (right - matrix @ x) / root
        return x

    if len(levels) == 1:
        return smooth(np.zeros_like(right), 8, 60)
    ny, nx = levels[0][0].shape
    spread = np.kron(spread_of(ny), spread_of(nx))
    x = smooth(np.zeros_like(right), 2, 8)
    x = x + spread @ cycle_of(levels[1:], spread.T @ (right - matrix @ x))
    return smooth(x, 2, 8)


def test_the_solver_solves_what_its_plain_twin_does() -> None:
    random = np.random.default_rng(3)
    for ny, nx in ((7, 9), (8, 6), (1, 5), (4, 1), (2, 2)):
        parts = parts_of(ny, nx, random)
        matrix = matrix_of(*(part.astype(float) for part in parts))
        h, right = (random.normal(size=(ny, nx)).astype(np.float32) for _ in range(2))
        levels, scratch, lines = solver(parts)
        out = np.empty((ny, nx), np.float32)
        _multigrid._apply(h, *parts, lines, out)
        np.testing.assert_allclose(out.ravel(), matrix @ h.ravel(), rtol=1e-5, atol=1e-4)
        _multigrid._scale(*parts, lines, out)
        np.testing.assert_allclose(out.ravel(), 1 / np.diag(matrix), rtol=1e-6)
        _multigrid.solve(h, right, levels, *scratch, out, lines, np.float32(1e-9), 60)
        np.testing.assert_allclose(h.ravel(), np.linalg.solve(matrix, right.ravel()), atol=1e-3)


def test_weights_are_those_of_the_plain_twin() -> None:
    random = np.random.default_rng(7)
    ny, nx = 9, 12
    h, z = (random.normal(0, 3e-5, (ny, nx)).astype(np.float32) for _ in range(2))
    weight = np.where(random.random((ny, nx)) < 0.5, 0.6, 0).astype(np.float32)
    sigma = random.uniform(1e-6, 3e-5, (ny, nx)).astype(np.float32)
    h[0], tie, slope = z[0], np.float32(0.4), np.float32(1e5)
    found = [
        np.empty(shape, np.float32) for shape in ((ny, nx), (ny, nx), (ny, nx - 1), (ny - 1, nx))
    ]
    hardest = np.float32(1e10)
    _multigrid._weigh(h, z, weight, sigma, np.float32(2), hardest, tie, slope, *found)
    away = np.maximum(np.abs(h - z) / sigma, 1e-9)
    pull = np.minimum(weight / sigma**2 * np.minimum(1, 2 / away), hardest)
    assert (pull == hardest).any()
    ties = [tie / np.sqrt(1 + np.square(np.diff(h, axis=axis) * slope)) for axis in (1, 0)]
    for mine, plain in zip(found, (pull, pull * z, *ties), strict=True):
        np.testing.assert_allclose(mine, plain, rtol=1e-4)


def test_the_solvers_cycle_is_that_of_its_plain_twin() -> None:
    random = np.random.default_rng(4)
    ny, nx = 11, 14
    levels, (x, right, image, way), lines = solver(parts_of(ny, nx, random))
    # No step: only the levels are made.
    h = np.zeros((ny, nx), np.float32)
    _multigrid.solve(h, h, levels, x, right, image, way, h.copy(), lines, np.float32(0), 0)
    for fine, coarse in itertools.pairwise(levels):
        pairs = [np.kron(np.eye(m), [1, 1]) for m in coarse[0].shape]
        fy, fx = (pair[:, :n] for pair, n in zip(pairs, fine[0].shape, strict=True))
        np.testing.assert_allclose(coarse[0], fy @ fine[0] @ fx.T, rtol=1e-5)
        np.testing.assert_allclose(coarse[1], fy @ fine[1] @ fx.T / 16, rtol=1e-5)
        tie_x, tie_y = fx[:-1, : fine[2].shape[1]], fy[:-1, : fine[3].shape[0]]
        np.testing.assert_allclose(coarse[2], fy @ fine[2] @ tie_x.T / 4, rtol=1e-5)
        np.testing.assert_allclose(coarse[3], tie_y @ fine[3] @ fx.T / 4, rtol=1e-5)
    right[0][:] = random.normal(size=(ny, nx))
    _multigrid._cycle(levels, x, right, image, way, lines)
    plain = cycle_of(levels, right[0].ravel().astype(float))
    np.testing.assert_allclose(x[0].ravel(), plain, rtol=1e-3, atol=1e-3 * np.abs(plain).max())


def test_a_few_steps_solve_what_has_hardly_an_anchor() -> None:
    random = np.random.default_rng(6)
    ny, nx = 101, 130
    parts = parts_of(ny, nx, random, known=0.01)
    # Few anchors and stiff between them: simple iterations take a thousand steps for it.
    parts[0] *= 100
    parts[1][:], parts[2][:], parts[3][:] = 100, 0.01, 0.01
    truth = random.normal(size=(ny, nx)).astype(np.float32).cumsum(0).cumsum(1) / 100
    levels, scratch, lines = solver(parts)
    h, right = np.zeros((ny, nx), np.float32), np.empty((ny, nx), np.float32)
    _multigrid._apply(truth, *parts, lines, right)
    _multigrid.solve(h, right, levels, *scratch, h.copy(), lines, np.float32(0), 12)
    assert np.abs(h - truth).mean() < 0.05 * np.abs(truth).mean()


def test_a_dome_goes_on_between_its_anchors_and_a_flat_top_stays_flat() -> None:
    random = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(100) * 1e-4 - 5e-3, np.arange(80) * 1e-4 - 4e-3)
    dome = 5e-4 - (x**2 + y**2) / 0.05
    top = np.clip((3e-3 - np.maximum(np.abs(x), np.abs(y))) / 5e-4, 0, 1) * 4e-4
    wall = (top > 0) & (top < 4e-4)
    for surface, known, limit in (
        (dome, random.random(x.shape) < 0.02, 1.5e-5),
        # Only the walls are seen, as on a plain coating.
        (top, wall & (random.random(x.shape) < 0.5), 5e-5),
    ):
        height = np.where(known, surface, np.nan).astype(np.float32)
        sigma = np.where(known, 3e-5, np.nan).astype(np.float32)
        error = np.abs(complete_surface(height, sigma, 1e-4) - surface)
        inside = np.maximum(np.abs(x), np.abs(y)) < 3e-3
        assert error[inside].mean() < limit


def test_cells_are_those_of_the_plain_twin() -> None:
    random = np.random.default_rng(10)
    x, y = random.uniform(-1, 8, (2, 200))
    height, sigma = random.normal(0, 1e-4, 200), random.uniform(0, 5e-5, 200)
    found = bin_points(x, y, height, sigma, (6, 7))
    for row, column in np.ndindex(6, 7):
        own = (np.floor(x) == column) & (np.floor(y) == row)
        assert found.points[row, column] == own.sum()
        if not own.any():
            assert np.isnan([found.height_m[row, column], found.sigma_m[row, column]]).all()
            assert not found.place[:, row, column].any()
            continue
        weight = 1 / np.maximum(sigma[own], 1e-6) ** 2
        mean = [np.average(v[own], weights=weight) for v in (height, x - column, y - row)]
        place = found.place[:, row, column] + 0.5
        np.testing.assert_allclose([found.height_m[row, column], *place], mean, rtol=1e-5)
        alike = np.sqrt(1 / np.mean(weight))
        several = np.sqrt(1 + (own.sum() - 1) / 3)
        np.testing.assert_allclose(found.sigma_m[row, column], alike / several, rtol=1e-5)


def test_the_nearest_known_cell_is_found_or_one_that_is_hardly_further() -> None:
    random = np.random.default_rng(11)
    for share in (0.001, 0.02, 0.3, 1.0):
        known = random.random((60, 90)) < share
        known[7, 5] = True
        index = nearest_known(known)
        assert known.ravel()[index].all()
        exact = ndimage.distance_transform_edt(~known)
        assert (distance_to(index) <= exact * 1.05 + 1e-5).all()
        assert (distance_to(index) >= exact - 1e-5).all()


def test_heights_at_middles_are_those_of_the_plain_twin() -> None:
    random = np.random.default_rng(8)
    for ny, nx in ((9, 12), (1, 5), (4, 1), (1, 1)):
        surface, height = random.normal(0, 5e-5, (2, ny, nx)).astype(np.float32)
        height[random.random((ny, nx)) < 0.3] = np.nan
        place = random.uniform(-0.5, 0.5, (2, ny, nx)).astype(np.float32)
        slopes = [
            np.gradient(surface.astype(float), 1e-4, axis=axis) if surface.shape[axis] > 1 else 0.0
            for axis in (1, 0)
        ]
        plain = height - 1e-4 * sum(
            np.clip(slope, -1, 1) * at for slope, at in zip(slopes, place, strict=True)
        )
        assert (np.abs(np.concatenate([np.ravel(s) for s in slopes])) > 1).any() or ny * nx < 9
        np.testing.assert_allclose(at_middles(surface, height, place, 1e-4), plain, rtol=1e-3)


def test_points_beside_a_cells_middle_do_not_lift_it_on_a_slope() -> None:
    random = np.random.default_rng(9)
    # One point in a tenth of the cells, of 0.1 mm, on a slope of 0.6.
    x, y = random.uniform(0, 100, (2, 1000))
    cells = bin_points(x, y, 6e-5 * x, np.full(1000, 1e-5), (100, 100))
    truth = 6e-5 * (np.arange(100) + 0.5)
    beside, placed = (
        np.abs(complete_surface(cells.height_m, cells.sigma_m, 1e-4, place) - truth)[10:-10, 10:-10]
        for place in (None, cells.place)
    )
    assert placed.mean() < 0.3 * beside.mean()


def test_on_coarse_grids_cells_that_claim_to_be_sure_do_not_throw_the_surface_off() -> None:
    random = np.random.default_rng(5)
    for _ in range(300):
        shape = tuple(random.integers(2, 50, 2))
        known = random.random(shape) < random.choice([0.01, 0.05, 0.25, 0.6])
        known[0, 0] = True
        scatter_m = random.choice([0.0, 1e-6, 1e-5, 1e-4])
        height = np.where(known, random.normal(0.05, scatter_m, shape), np.nan)
        sigma = np.where(known, random.choice([0.0, 1e-9, 1e-6, 1e-5, 1e-3], shape), np.nan)
        found = complete_surface(height.astype(np.float32), sigma.astype(np.float32), 2e-3)
        low, high = np.nanmin(height), np.nanmax(height)
        beyond = 3 * (high - low) + 1e-4
        assert ((low - beyond <= found) & (found <= high + beyond)).all()


def test_beside_steep_walls_the_unseen_is_not_higher_or_lower_than_what_was_seen() -> None:
    x, y = np.meshgrid(np.arange(100) * 1e-4 - 5e-3, np.arange(80) * 1e-4 - 4e-3)
    # A plateau, of which the wall is seen, and flat ground far from it.
    top = np.clip((3e-3 - np.hypot(x, y)) / 2e-4, 0, 1) * 4e-4
    known = ((top > 0) & (top < 4e-4)) | (np.abs(x) > 4.5e-3)
    height = np.where(known, top, np.nan).astype(np.float32)
    completed = complete_surface(height, np.where(known, 2e-5, np.nan).astype(np.float32), 1e-4)
    beyond = np.hypot(x, y) < 2.5e-3
    assert completed[beyond].max() > 4.2e-4
    before = completed.copy()
    hold_gaps(completed, height, np.zeros(known.shape, bool))
    assert completed[beyond].max() <= np.nanmax(height)
    assert (completed[known] == before[known]).all()


def test_painted_triangles_are_those_of_the_plain_twin() -> None:
    random = np.random.default_rng(5)
    corners = random.integers(0, 12, (300, 3, 2))
    corners[0], corners[1] = [[2, 2], [4, 4], [6, 6]], [[3, 1], [3, 1], [7, 9]]
    heights = random.random((300, 3), np.float32)
    for k in range(0, 300, 3):  # few at a time leave cells that none covers
        found = np.full((2, 12, 12), [[[np.inf]], [[-np.inf]]], np.float32)
        plain = found.copy()
        _kernels._paint(corners[k : k + 3], heights[k : k + 3], *found)
        cells = np.indices((12, 12))
        for (a, b, c), height in zip(corners[k : k + 3], heights[k : k + 3], strict=True):
            sides = np.stack([
                (q[1] - p[1]) * (cells[0] - p[0]) - (q[0] - p[0]) * (cells[1] - p[1])
                for p, q in ((a, b), (b, c), (c, a))
            ])  # fmt: skip
            inside = (sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)
            if (b - a)[1] * (c - a)[0] != (b - a)[0] * (c - a)[1]:
                plain[0][inside] = np.minimum(plain[0][inside], height.min())
                plain[1][inside] = np.maximum(plain[1][inside], height.max())
        assert (found == plain).all()


def test_too_few_measured_cells_hold_nothing() -> None:
    for places in ([], [(3, 3)], [(3, k) for k in range(9)]):
        measured = np.full((9, 9), np.nan, np.float32)
        for place in places:
            measured[place] = 1e-4
        height = np.full((9, 9), 3e-4, np.float32)
        hold_gaps(height, measured, np.zeros((9, 9), bool))
        assert (height == np.float32(3e-4)).all()


def test_scatter_sees_errors_but_neither_form_nor_walls() -> None:
    random = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(120) * 1e-4, np.arange(120) * 1e-4)
    form = 0.2 * x + 8 * x * y + 4e-4 * (x > 6e-3)
    noise = errors(x.shape, 1e-4, 3e-5, random)
    measured = random.random(x.shape) < 0.6
    quiet = scatter_of(form.astype(np.float32), measured, 1e-4)
    loud = scatter_of((form + noise).astype(np.float32), measured, 1e-4)
    assert np.nanmax(quiet) < 1e-5
    assert 1.5e-5 < np.nanmedian(loud) < 6e-5
    assert np.isnan(scatter_of(form.astype(np.float32), random.random(x.shape) < 0.01, 1e-4)).all()
