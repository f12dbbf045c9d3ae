"""Loops that look for lattices, against what they do in numpy."""

import numpy as np
import pytest

from roller_braille import _lattice_kernels as kernels

CELL, DOT, WIDTH, STEP = 6e-3, 2.5e-3, 6e-4, 1e-4
LATTICE = 0.01, -0.002, 6.1e-3, 2.45e-3, 2.55e-3, np.cos(0.03), np.sin(0.03)


def dots(count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along and down, metres, and weights; some on the lattice, nearly."""
    rng = np.random.default_rng(seed)
    n, column, row = rng.integers(0, [4, 2, 3], (count, 3)).T
    x = n * LATTICE[2] + column * LATTICE[3] + rng.normal(0, 2e-4, count)
    y = row * LATTICE[4] + rng.normal(0, 2e-4, count)
    x[::5] += rng.uniform(-3e-3, 3e-3, len(x[::5]))
    c, s = LATTICE[5:]
    return LATTICE[0] + c * x - s * y, LATTICE[1] + s * x + c * y, rng.uniform(50, 200, count)


def near(distance: np.ndarray) -> np.ndarray:
    return np.maximum(1.0 - np.abs(distance) / (2 * WIDTH), 0.0)


def slow_own(along: np.ndarray, down: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, (c, s) = along - LATTICE[0], down - LATTICE[1], LATTICE[5:]
    return c * x + s * y, c * y - s * x


def slow_nearest(along: np.ndarray, down: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rest, across = slow_own(along, down)
    _, _, cell, dot_along, dot_down, _, _ = LATTICE
    n = np.floor((rest - dot_along / 2) / cell + 0.5)
    inside = rest - n * cell
    column = (inside > dot_along / 2).astype(np.float64)
    row = np.clip(np.round(across / dot_down), 0, 2)
    off = np.hypot(inside - column * dot_along, across - row * dot_down)
    return np.stack([n, column, row], axis=1).astype(np.int64), off


def nearest(along: np.ndarray, down: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    index, off = np.empty((len(along), 3), np.int64), np.empty(len(along))
    kernels._nearest(along, down, LATTICE, index, off)
    return index, off


@pytest.mark.parametrize("count", [0, 1, 200])
def test_nearest(count: int) -> None:
    along, down, _ = dots(count)
    index, off = nearest(along, down)
    want_index, want_off = slow_nearest(along, down)
    np.testing.assert_array_equal(index, want_index)
    np.testing.assert_allclose(off, want_off, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("count", [1, 2, 7, 60])
def test_fit(count: int) -> None:
    along, down, _ = dots(count, seed=count)
    index, off = nearest(along, down)
    on = off < 6e-4
    sigma, prior = 1.5e-4, np.array([1e-3, 0.01, 0.03, 1e-3, 0.01, 0.03])
    x = np.empty(6)
    kernels._fit(along, down, LATTICE, index, on, (CELL, DOT), sigma, prior, x)
    rest, across = (part[on] for part in slow_own(along, down))
    n, column, row = index[on].T
    design = np.zeros((2, len(n), 6))
    design[0, :, 0] = design[1, :, 3] = 1.0
    design[0, :, 1], design[0, :, 2], design[0, :, 4] = n * CELL, column * DOT, -across
    design[1, :, 4], design[1, :, 5] = rest, row * DOT
    target = np.concatenate([rest - n * CELL - column * DOT, across - row * DOT]) / sigma
    a = design.reshape(-1, 6) / sigma
    want = np.linalg.solve(a.T @ a + np.diag(prior**-2.0), a.T @ target)
    np.testing.assert_allclose(x, want, rtol=1e-8, atol=1e-12)


def test_score_rows() -> None:
    _, down, weight = dots(40)
    pitches, shares = DOT * np.linspace(0.96, 1.04, 7), np.array([1.0, 0.94, 0.88])
    top = np.arange(down.min() - 2 * pitches.max(), down.max() + STEP, STEP)
    total = np.zeros((len(top), len(pitches)))
    kernels._score_rows(down, weight, top, STEP, pitches, WIDTH, shares, total)
    rows = top[:, None, None] + pitches[None, :, None] * np.arange(3)
    want = ((near(rows[..., None] - down) @ weight) * shares).sum(axis=-1)
    np.testing.assert_allclose(total, want, atol=1e-9)


@pytest.mark.parametrize("favoured", [0, 1])
def test_score_cells(favoured: int) -> None:
    along, _, weight = dots(40)
    along = along - along.min()
    cells, start = CELL * np.linspace(0.96, 1.04, 7), np.arange(0.0, CELL, STEP)
    shares = (1.0, 0.94) if favoured == 0 else (0.94, 1.0)
    total = np.zeros((len(start), len(cells)))
    kernels._score_cells(along, weight, start, cells, DOT, WIDTH, shares, total)
    want = np.zeros((2, *total.shape, len(along)))
    # Of the cell that a dot lies in and of those beside it.
    for column in (0, 1):
        for cell in (-1, 0, 1):
            rest = np.mod(along - start[:, None, None], cells[:, None])
            away = rest - column * DOT + cell * cells[:, None]
            want[column] = np.maximum(want[column], near(away) * shares[column])
    np.testing.assert_allclose(total, want.max(axis=0) @ weight, atol=1e-9)


def test_score_turns() -> None:
    along, down, weight = dots(30)
    turns, apart, width = np.linspace(-0.2, 0.2, 49), 1.5 * DOT, 4e-4
    score = np.zeros(len(turns))
    kernels._score_turns(along, down, weight, apart, np.cos(turns), np.sin(turns), width, score)
    i, j = np.triu_indices(len(along), 1)
    x, y = along[j] - along[i], down[j] - down[i]
    pairs = (weight[i] * weight[j]) * (np.hypot(x, y) > apart)
    beside = np.abs(np.cos(turns)[:, None] * y - np.sin(turns)[:, None] * x)
    want = np.maximum(1.0 - beside / width, 0.0) @ pairs
    np.testing.assert_allclose(score, want, rtol=1e-10)
