"""Quadrics through many neighbourhoods at once, beside one fit after the other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from roller_calibration.dome_candidates import _dome_tops, dome_places

RADIUS_M, DISC_M = 0.005, 0.0025


def top_of(cells: np.ndarray, place: np.ndarray) -> np.ndarray | None:
    """The same of one neighbourhood, by least squares weighted anew twice."""
    x, y = ((cells[:, :2] - place) / DISC_M).T
    design = np.column_stack([np.ones(len(x)), x, y, 0.5 * x * x, x * y, 0.5 * y * y])
    weight = np.ones(len(x))
    for _ in range(3):
        solution = np.linalg.lstsq(design * weight[:, None], cells[:, 2] * weight, rcond=None)[0]
        miss = np.abs(cells[:, 2] - design @ solution)
        scale = float(np.median(miss))
        weight = np.sqrt(1 / np.maximum(miss / (2 * scale), 1))
    bend = -np.array([[solution[3], solution[4]], [solution[4], solution[5]]]) / DISC_M**2
    low, high = np.linalg.eigvalsh(bend) * RADIUS_M
    if scale > 0.05 * RADIUS_M or low < 0.25 or high > 4 or high > 3 * low:
        return None
    shift = np.linalg.solve(bend, solution[1:3] / DISC_M)
    if np.hypot(*shift) > 0.5 * DISC_M:
        return None
    height = solution[0] + 0.5 * (solution[1:3] / DISC_M) @ shift
    return np.array([*(place + shift), height, 0.5 * (low + high) / RADIUS_M])


def cells_around(rng: np.random.Generator, place: np.ndarray, kind: str) -> np.ndarray:
    n = int(rng.integers(12, 300))
    xy = place + DISC_M * rng.uniform(-0.7, 0.7, (n, 2))
    if kind == "row":
        xy[:, 1] = place[1]
    middle = place + rng.uniform(-0.4, 0.4, 2) * DISC_M
    bends = {"dome": (1.0, 1.3), "flat": (0.0, 0.0), "ridge": (0.0, 1.0), "row": (1.0, 1.0)}[kind]
    z = -0.5 / RADIUS_M * ((xy - middle) ** 2 @ np.array(bends))
    z += rng.normal(0, 1e-5, n)
    z[: n // 10] += 5e-4
    return np.column_stack([xy, z])


def test_tops_of_many_are_those_of_each() -> None:
    rng = np.random.default_rng(5)
    places, parts = rng.uniform(-0.02, 0.02, (60, 2)), []
    for k, place in enumerate(places):
        parts.append(cells_around(rng, place, ("dome", "dome", "flat", "ridge", "row")[k % 5]))
    ends = np.cumsum([0, *map(len, parts)])
    members = [np.arange(a, b) for a, b in pairwise(ends)]
    found = _dome_tops(np.concatenate(parts), places, members, DISC_M, RADIUS_M)
    domes = 0
    for own, part, place in zip(found, parts, places, strict=True):
        expected = top_of(part, place)
        assert np.isfinite(own).all() == (expected is not None)
        if expected is not None:
            domes += 1
            np.testing.assert_allclose(own[:3], expected[:3], atol=1e-8)
            np.testing.assert_allclose(own[3], expected[3], rtol=1e-4)
    assert 15 <= domes <= 30


@pytest.mark.parametrize("count", [0, 5])
def test_of_too_few_cells_nothing_is_found(count: int) -> None:
    points = np.zeros((3 * count, 3)) + np.linspace(0, 1e-4, 3 * count)[:, None]
    assert dome_places(points, RADIUS_M) == []
