"""Points follow the lines around them; twins of the loops."""

import numpy as np
import pytest

from roller_emvs.evidence import Relief
from roller_emvs.lines import _place_kernels as places
from roller_emvs.lines.follow import _around, move_points, widen_sigma
from roller_emvs.lines.line_points import LinePoints

SHAPE = (40, 60)


def points_and_lines(seed: int) -> tuple[np.random.Generator, dict[str, np.ndarray]]:
    """Some points at pixels, and lines."""
    rng = np.random.default_rng(seed)
    pixel = np.sort(rng.choice(SHAPE[0] * SHAPE[1], 900, replace=False))
    row, column = np.divmod(pixel, SHAPE[1])
    return rng, {
        "row": row,
        "column": column,
        "offset": rng.normal(0, 1, len(row)),
        "sigma": rng.uniform(0.1, 2, len(row)).astype(np.float32),
        "sure": rng.random(len(row)).astype(np.float32),
        "line_row": np.sort(rng.integers(0, SHAPE[0], 200)),
        "line_column": rng.uniform(-1, SHAPE[1], 200),
        "line_sigma": rng.uniform(0.1, 2, 200),
        "tilt": rng.normal(0, 0.5, 200),
    }


def plainly_between(sums: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values of the lines' grid at pixels, linear between cells."""
    height, width, _ = sums.shape
    y, x = row / places.GRID_PX, (column - (places.GRID_PX - 1) / 2) / places.GRID_PX
    y, x = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
    down = np.maximum(1 - np.abs(y[:, None] - np.arange(height)), 0)
    along = np.maximum(1 - np.abs(x[:, None] - np.arange(width)), 0)
    return np.einsum("ni,nj,ijv->vn", down, along, sums)


def test_points_are_as_unsure_as_the_lines_around_them() -> None:
    none, row = np.zeros(4), np.array([10.0, 12.0, 10.0, 12.0])
    lines = LinePoints(row, np.array([15.0, 15.0, 45.0, 45.0]), *[none] * 9)
    own = np.full(3, 3.0, np.float32)
    surface = np.zeros(SHAPE, np.float32)
    at = np.array([11, 11, 35]), np.array([18.4, 47.0, 5.0])
    found = Relief(
        *at, np.zeros(3), own, own, own, 0 * own, (surface, surface), (surface, surface), surface
    )
    less = widen_sigma(found, lines, np.array([4.0, 4.0, 0.0, 0.0]))
    np.testing.assert_allclose(less.sigma, [5.0, 3.0, 3.0], rtol=1e-3)
    np.testing.assert_array_equal(less.offset, found.offset)


@pytest.mark.parametrize("stiff", [1.0, np.inf])
def test_points_move_as_the_lines_around_say(stiff: float) -> None:
    rng, p = points_and_lines(11)
    row, column = p["line_row"], np.clip(np.rint(p["line_column"]).astype(int), 0, SHAPE[1] - 1)
    weight, move, middle = p["line_sigma"] ** -2, rng.normal(0, 0.5, len(row)), 0.5 * SHAPE[1]
    x = p["line_column"] - middle
    values = weight * np.stack([x**0, move, move**2, x, x**2, move * x])
    size = places.GRID_PX
    sums = np.zeros((SHAPE[0] // size, SHAPE[1] // size, 6), np.float32)
    expected = np.zeros_like(sums)
    places._add_lines(row, column, values, sums)
    np.add.at(expected, (row // size, column // size), values.T)
    np.testing.assert_allclose(sums, expected, rtol=1e-5)
    n, peak, floor = len(p["row"]), 20.0, 0.04
    moved, unsure = np.empty(n), np.empty(n, np.float32)
    at, limits = (p["row"], p["column"]), (middle, stiff, peak, floor)
    places._move(*at, p["offset"], p["sigma"], sums, limits, moved, unsure)
    total, *means = plainly_between(sums.astype(np.float64), *at)
    mean, square, x, xx, shared = np.array(means) / np.maximum(total, 1e-30)
    apart = np.maximum(square - mean**2, 0)
    slope = (shared - mean * x) / (np.maximum(xx - x**2, 0) + stiff)
    by = mean + slope * (p["column"] - middle - x)
    own = 1 / np.maximum(total * peak, 1e-30) + floor
    gain = p["sigma"] ** 2 / (p["sigma"] ** 2 + own)
    left = np.minimum(p["sigma"] ** 2, np.maximum((1 - gain) * p["sigma"] ** 2, own))
    sigma = np.sqrt(left + np.sqrt(gain) * apart + ((1 - gain) * by) ** 2)
    np.testing.assert_allclose(moved, p["offset"] + gain * by, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(unsure, sigma, rtol=1e-3, atol=1e-3)


def test_foot_and_top_of_a_wall_move_apart() -> None:
    """Which a mean of the lines around would level."""
    surface, rows = np.zeros(SHAPE, np.float32), np.arange(0, SHAPE[0], 2)
    row = np.tile(rows, 2).astype(np.float64)
    zero = np.zeros(len(row))
    foot, top = 22, 26
    lines = LinePoints(
        row, np.repeat([foot, top], len(rows)).astype(float), zero, zero.astype(int), *[zero] * 7
    )
    offset, sigma = np.repeat([-20e-6, 20e-6], len(rows)), np.full(len(row), 5e-6)
    x = np.arange(20, 29)
    own = np.full(len(x), 1e-4, np.float32)
    found = Relief(
        np.full(len(x), SHAPE[0] // 2), x, np.zeros(len(x)), own, own, own, 0 * own,
        (surface, surface), (surface, surface), surface,
    )  # fmt: skip
    moved = move_points(found, lines, offset, sigma, 1.0).offset
    np.testing.assert_allclose(moved[x == (foot + top) // 2], 0.0, atol=1e-6)
    assert -20e-6 < moved[x == foot] < -12e-6
    assert 12e-6 < moved[x == top] < 20e-6


def test_what_is_around_a_place_is_a_gaussian_of_the_lines() -> None:
    """On a coarser grid, and yet the neighbourhood is no wider."""
    shape, spread = (80, 96), 4.0
    rows, columns = np.meshgrid([30.0], np.arange(40.0, 56.0), indexing="ij")
    some = np.zeros(rows.size)
    lines = LinePoints(rows.ravel(), columns.ravel(), *[some] * 9)
    i, j = (v.ravel() for v in np.meshgrid(np.arange(20, 40), np.arange(35, 60), indexing="ij"))
    around = _around(lines, np.ones((2, rows.size)), shape, i, j)
    corners = np.array([0, 79]), np.array([0, 95])
    everywhere = _around(lines, np.ones((2, rows.size)), shape, *corners)
    cells = np.ix_(np.arange(20, 41) // places.GRID_PX, np.arange(34, 61) // places.GRID_PX)
    np.testing.assert_allclose(around[cells], everywhere[cells], rtol=1e-5)
    found = plainly_between(around.astype(np.float64), i, j)[0] / places.GRID_PX**2
    apart = (i[:, None] - rows.ravel()) ** 2 + (j[:, None] - columns.ravel()) ** 2
    expected = np.exp(-0.5 * apart / spread**2).sum(axis=1) / (2 * np.pi * spread**2)
    np.testing.assert_allclose(found, expected, rtol=0.03, atol=0.01 * expected.max())


def test_a_line_beside_the_surface_leaves_the_points_around_as_they_are() -> None:
    """Where its polarity has no surface it says nothing of how far points are off."""
    surface = np.full(SHAPE, np.nan, np.float32)
    surface[:, :20] = 0.0
    row, zero = np.array([10.0, 10.0]), np.zeros(2)
    lines = LinePoints(row, np.array([10.0, 24.0]), zero, np.zeros(2, np.int64), *[zero] * 7)
    alone = LinePoints(**{name: values[:1] for name, values in lines.__dict__.items()})
    own = np.full(2, 1.0, np.float32)
    place = np.array([10, 10]), np.array([10, 19])
    found = Relief(*place, np.zeros(2), own, own, own, 0 * own, (surface, surface), (), surface)
    offset, sigma = np.array([0.5, 0.7]), np.array([0.1, 0.1])
    moved = move_points(found, lines, offset, sigma, 1.0)
    expected = move_points(found, alone, offset[:1], sigma[:1], 1.0)
    assert (moved.offset > 0.3).all()
    np.testing.assert_array_equal(moved.offset, expected.offset)
    np.testing.assert_array_equal(moved.sigma, expected.sigma)


def test_lines_that_are_surer_than_the_points_beside_them_become_points() -> None:
    _, p = points_and_lines(12)
    row, column, tilt, sigma = (p[k] for k in ("line_row", "line_column", "tilt", "line_sigma"))
    number = np.full(SHAPE, -1, np.int32)
    number[p["row"], p["column"]] = np.arange(len(p["row"]))
    room = 2 * len(row)
    line, to_row, beside = np.empty((3, room), np.int64)
    to_column, most = np.empty(room), np.empty(room + 1, np.float32)
    count = places._surer(
        row, column, tilt, sigma, 2, 1, number, p["sigma"], p["sure"], np.full(SHAPE, np.inf),
        line, to_row, to_column, beside, most,
    )  # fmt: skip
    held = [
        (i, r, c, range(near - 1, near + 2))
        for step in range(2)
        for i, (r, c) in enumerate(zip(row + step, column + tilt * step, strict=True))
        if r < SHAPE[0] and 1 <= (near := int(np.rint(c))) < SHAPE[1] - 1
    ]
    expected = []
    for i, r, c, near in held:
        points = [number[r, j] for j in near if number[r, j] >= 0]
        rivals = [sigma[k] for k, y, _, other in held if y == r and set(other) & set(near)]
        if points and sigma[i] <= min(rivals) and sigma[i] < min(p["sigma"][points]):
            best = points[int(np.argmin(p["sigma"][points]))]
            expected.append((i, r, c, best, p["sure"][points].max()))
    assert 20 < count == len(expected)
    for own, values in zip((line, to_row, to_column, beside, most), zip(*expected, strict=True),
                           strict=True):  # fmt: skip
        np.testing.assert_array_equal(own[:count], values)
