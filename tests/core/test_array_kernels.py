"""Loops that stand in for numpy's inside kernels."""

import numpy as np
import pytest

from roller_core import _array_kernels as kernels


def test_copy():
    values, out = np.arange(6.0).reshape(3, 2), np.zeros(5)
    kernels._copy(values[:, 1], out[1:])
    np.testing.assert_array_equal(out, [0, 1, 3, 5, 0])


@pytest.mark.parametrize("kind", [np.int32, np.int64, np.float32, np.float64])
def test_least_and_most(kind):
    values = np.random.default_rng(3).integers(-50, 50, (40, 2)).astype(kind)
    assert kernels._least(values[:, 1]) == values[:, 1].min()
    assert kernels._most(values[:, 0]) == values[:, 0].max()


@pytest.mark.parametrize("count", [0, 1, 2, 7, 64])
def test_count_up_to(count):
    values = np.sort(np.random.default_rng(count).integers(0, 20, count))
    for limit in range(-1, 22):
        assert kernels._count_up_to(values, limit) == np.searchsorted(values, limit, side="right")


@pytest.mark.parametrize("count", range(1, 65))
def test_median_of_few(count):
    values = np.random.default_rng(count).integers(0, 30, count) / 7.0
    assert kernels._median_of_few(values.copy()) == np.median(values)


def test_median_of_none():
    assert np.isnan(kernels._median_of_few(np.empty(0)))
