"""The nearest of a cloud, against all distances."""

import numpy as np
import pytest

from roller_emvs.near import NearCloud, bounds


def surface(count: int, normal: int, seed: int = 2) -> np.ndarray:
    """Points within 4 mm, nearly in a plane."""
    points = np.random.default_rng(seed).uniform(0.5, 0.504, (count, 3))
    points[:, normal] *= 0.1
    return points


def check(cloud: np.ndarray, places: np.ndarray, count: int, most_m: float, edge_m: float) -> None:
    away, number = NearCloud(cloud, edge_m).nearest(places, count, most_m)
    every = np.linalg.norm(cloud[None] - places[:, None], axis=2)
    want = np.sort(np.where(every < most_m, every, np.inf), axis=1)[:, :count]
    want = np.pad(want, ((0, 0), (0, count - want.shape[1])), constant_values=np.inf)
    np.testing.assert_allclose(away, want, rtol=1e-12)
    assert ((number == len(cloud)) == np.isinf(want)).all()
    known = np.isfinite(want)
    own = np.take_along_axis(every, np.minimum(number, len(cloud) - 1), axis=1)
    np.testing.assert_allclose(own[known], want[known], rtol=1e-12)


@pytest.mark.parametrize("normal", [0, 1, 2])
@pytest.mark.parametrize(("count", "most_m"), [(1, 3e-4), (30, 1.2e-3), (5, np.inf)])
def test_nearest_of_a_surface(normal: int, count: int, most_m: float) -> None:
    cloud = surface(700, normal)
    places = np.concatenate([surface(60, normal, 3), surface(30, normal, 4) + 0.0021])
    check(cloud, places, count, most_m, 3e-4)


@pytest.mark.parametrize("edge_m", [1e-5, 1e-3, 1.0])
def test_any_edge_of_cells_will_do(edge_m: float) -> None:
    check(surface(300, 2), surface(40, 2, 5), 3, 5e-4, edge_m)


def test_one_point_and_places_far_away() -> None:
    check(np.full((1, 3), 0.5), np.array([[0.5, 0.5, 0.5001], [3.0, -2.0, 0.0]]), 2, 1.0, 1e-3)


def test_points_in_a_line() -> None:
    cloud = np.zeros((50, 3))
    cloud[:, 1] = np.linspace(0.0, 0.01, 50)
    check(cloud, cloud[::7] + 1e-5, 4, 1e-3, 3e-4)


def test_bounds() -> None:
    points = surface(50, 1)
    low, high = bounds(points[::-1])
    np.testing.assert_array_equal(low, points.min(axis=0))
    np.testing.assert_array_equal(high, points.max(axis=0))
