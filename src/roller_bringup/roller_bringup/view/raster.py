"""Points as small arrays of cells: how many fell into each, and their sums."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]

#: Cells of one array at most: so many, and of each point so many more.
_MOST_CELLS, _MOST_A_POINT = 1 << 16, 4


@dataclass(frozen=True)
class Raster:
    """Cells of a rectangle. All arrays have shape (ny, nx)."""

    #: The first cell.
    x0: int
    y0: int
    #: Points in each.
    count: I64
    #: Of each column's values.
    sums: Mapping[str, F64]
    #: The best of the points'; 0 where there are none.
    state: U8


def rasters(i: I64, j: I64, values: Mapping[str, F32], state: U8, tile: int) -> Iterator[Raster]:
    """Points in one array, or in one for each square of cells that they are in.

    Parameters
    ----------
    i, j : ndarray of int64, shape (n,)
        Cells that they fall into; n > 0.
    values : mapping of str to ndarray, shape (n,)
        What is summed up.
    state : ndarray of uint8, shape (n,) or ()
        Of each point, or of all.
    tile : int
        Edge of the squares, cells.
    """
    nx, ny = (int(np.ptp(k)) + 1 for k in (i, j))
    if nx * ny <= _MOST_CELLS + _MOST_A_POINT * len(i):
        yield _raster(i, j, values, state)
        return
    for chosen in _by_square(i // tile, j // tile):
        part = {name: column[chosen] for name, column in values.items()}
        yield _raster(i[chosen], j[chosen], part, state[chosen] if state.ndim else state)


def _raster(i: I64, j: I64, values: Mapping[str, F32], state: U8) -> Raster:
    x0, y0 = int(i.min()), int(j.min())
    shape = (int(j.max()) - y0 + 1, int(i.max()) - x0 + 1)
    at = (j - y0) * shape[1] + (i - x0)
    size = shape[0] * shape[1]
    count = np.bincount(at, minlength=size)
    sums: dict[str, F64] = {}
    for name, column in values.items():
        found: F64 = np.bincount(at, column, size).astype(np.float64, copy=False)
        sums[name] = found.reshape(shape)
    best = np.zeros(size, np.uint8)
    if state.ndim:
        np.maximum.at(best, at, state)
    else:
        best[count > 0] = state
    return Raster(x0, y0, count.reshape(shape), sums, best.reshape(shape))


def _by_square(tx: I64, ty: I64) -> Iterator[I64]:
    """Of each square that points are in: which of them."""
    order = np.lexsort((ty, tx))
    new = (np.diff(tx[order]) != 0) | (np.diff(ty[order]) != 0)
    yield from np.split(order, np.flatnonzero(new) + 1)
