"""Sharpness over the planes of the surface sweep, by slow forms."""

import numpy as np
import pytest

from roller_emvs.evidence import CELL_PX
from roller_emvs.methods.surface import _sharpness_kernels
from roller_emvs.methods.surface._part_kernels import BINS_PX, ROW_PX, TILE_BINS, TILE_CELLS

from .part_votes import CELLS, LEFT, PARTS, ROWS, SHAPE, TILES, base_of, by_rows, some_votes


def test_tiles_are_searched_on_the_planes_of_the_cells_around() -> None:
    rng = np.random.default_rng(6)
    shape, around, planes = (9, 4 * TILE_CELLS - 1), 2, 20
    first = rng.integers(-3, 15, shape).astype(np.int32)
    last = np.where(rng.random(shape) < 0.8, -1, first + 5).astype(np.int32)
    reached = rng.random((shape[0], 4)) < 0.7
    own, tiles = np.empty((2, *reached.shape, 2), np.int32)
    _sharpness_kernels._tiles_around(first, last, reached, around, planes, own, tiles)
    for i, t in np.ndindex(reached.shape):
        near = (
            slice(max(i - around, 0), i + around + 1),
            slice(max(t * TILE_CELLS - around, 0), (t + 1) * TILE_CELLS + around),
        )
        some = last[near] >= 0
        if reached[i, t] and some.any():
            expected = [first[near][some].min(), last[near][some].max()]
        else:
            expected = [planes, -1]
        np.testing.assert_array_equal(tiles[i, t], expected)


def twin_sharpness(votes: np.ndarray, bins_px: int) -> np.ndarray:
    """Squared slopes of bins' votes, each shared by two columns, mean over phases."""
    one = np.ones(bins_px)
    triangle = np.convolve(one, one) / bins_px
    shared = np.apply_along_axis(np.convolve, -1, votes, triangle, mode="same")
    taps = np.zeros(4 * bins_px + 1)
    taps[[0, bins_px, 3 * bins_px, 4 * bins_px]] = 0.4, 1.0, -1.0, -0.4
    slope = np.apply_along_axis(np.convolve, -1, shared, taps, mode="same")
    return np.asarray(slope**2 / bins_px)


@pytest.mark.parametrize("crowded", [True, False])
@pytest.mark.parametrize(("groups", "pairs", "halve"), [(1, 2, 0), (4, 1, 0), (4, 1, 1)])
def test_sharpness_is_that_of_the_sum_of_shifted_parts(
    groups: int, pairs: int, halve: int, crowded: bool
) -> None:
    rng = np.random.default_rng(4)
    votes, starts, histogram = some_votes(rng, crowded)
    shifts = rng.integers(-20, 21, (6, PARTS)) >> halve
    cells = (ROWS // CELL_PX, (TILES - 2) * TILE_CELLS - 1)
    tiles = np.array([[[0, 5], [2, 3], [5, 4]], [[1, 4], [0, 5], [0, 5]]], np.int32)
    bins, left, bins_px = SHAPE[2] >> halve, LEFT >> halve, BINS_PX >> halve
    found = np.zeros((6, *cells), np.float32)
    kinds = (np.uint8, np.uint16, np.uint16)
    buffers = tuple(np.full(bins + TILE_BINS, 77, kind) for kind in kinds)
    pair = (PARTS + 1) * bins
    base = np.minimum(base_of(pair, bins, ROW_PX), pairs * pair)
    image = np.zeros(pairs * pair + bins, np.uint8)
    for begin in range(2):
        _sharpness_kernels._measure(
            votes, starts, base, (*SHAPE[:2], bins), left, halve, begin, cells[0], 2, groups,
            pairs, image, shifts, tiles, buffers, np.full(bins, 9.0, np.float32), found,
        )  # fmt: skip
    assert not image.any()
    merged = histogram.reshape(*histogram.shape[:2], bins, -1).sum(axis=-1)
    counted = by_rows(merged, ROW_PX)
    for k in range(6):
        moved = np.stack(
            [np.roll(counted[:, j], shifts[k, j], axis=-1) for j in range(PARTS)], axis=1
        )
        total = np.zeros((ROWS // CELL_PX, bins))
        for part in np.split(moved, groups, axis=1):
            two = part.sum(axis=1).reshape(CELLS, CELL_PX // ROW_PX, -1)
            total += twin_sharpness(two[:, :pairs], bins_px).sum(axis=1)
        own = total[:, left : -left or None].reshape(cells[0], -1, CELL_PX * bins_px).sum(-1)
        own = own[:, : cells[1]]
        looked_at = (tiles[..., 0] <= k) & (k <= tiles[..., 1])
        looked_at = np.repeat(looked_at, TILE_CELLS, axis=1)[:, : cells[1]]
        np.testing.assert_allclose(found[k], np.where(looked_at, own, 0), rtol=1e-4, atol=1e-4)


def test_whether_sums_of_parts_fit_a_byte_however_they_are_moved() -> None:
    image = np.zeros((2, PARTS + 1, 64), np.uint8)
    image[:, :PARTS] = np.random.default_rng(8).integers(0, 9, (2, PARTS, 64))
    shape, most = (ROWS, PARTS, 64), int(image[1, :PARTS].max(axis=1).sum())
    rest = most - int(image[1, 3].max())
    for value, fits in ((255 - rest, True), (256 - rest, False)):
        image[1, 3, 7] = value
        assert _sharpness_kernels._fit_byte(image.reshape(-1), shape, 2, 1) == fits
        assert _sharpness_kernels._fit_byte(image.reshape(-1), shape, 1, 1)
        assert _sharpness_kernels._fit_byte(image.reshape(-1), shape, 2, PARTS // 2)
