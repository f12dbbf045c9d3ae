"""Votes of the surface sweep's parts, and the same as a histogram."""

import numpy as np

from roller_emvs.evidence import CELL_PX
from roller_emvs.methods.surface._part_kernels import BIN_BITS, MOST, TILE_BINS

ROWS, PARTS, TILES, LEFT = 8, 8, 5, TILE_BINS
SHAPE = (ROWS, PARTS, TILES * TILE_BINS)
CELLS = ROWS // CELL_PX


def some_votes(
    rng: np.random.Generator, crowded: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Votes, where each row of cells begins, and the same as a histogram of `SHAPE`."""
    histogram = rng.poisson(0.3, SHAPE)
    if crowded:  # sums of all parts exceed a byte
        histogram[:, :, LEFT + 30] = 2 * MOST
    # Bins that count no further.
    histogram[2, 3, LEFT + 20], histogram[5, 1, LEFT + 40] = 2 * MOST, 5 * MOST
    row, part, at = (np.repeat(v, histogram.ravel()) for v in np.indices(SHAPE).reshape(3, -1))
    order = np.lexsort((rng.random(len(row)), row // CELL_PX))
    votes = ((row % CELL_PX * PARTS + part) << BIN_BITS | at)[order].astype(np.uint32)
    starts = np.searchsorted(row // CELL_PX, np.arange(CELLS + 1))
    return votes, starts, histogram


def base_of(of_row: int, of_part: int, rows: int) -> np.ndarray:
    """Where the image of a row and part begins, so many rows in one."""
    row, part = np.divmod(np.arange(CELL_PX * PARTS), PARTS)
    return np.asarray(row // rows * of_row + part * of_part)


def by_rows(histogram: np.ndarray, rows: int) -> np.ndarray:
    """Sums of so many rows, each bin up to so many times `MOST`."""
    sums = histogram.reshape(ROWS // rows, rows, *histogram.shape[1:]).sum(axis=1)
    return np.asarray(np.minimum(sums, rows * MOST), np.float64)
