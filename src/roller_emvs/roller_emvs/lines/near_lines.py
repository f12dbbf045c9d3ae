"""Which line each pixel of a grid is next to."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

from .fit import I64


def near_lines(
    row: I64, column: F64, shape: tuple[int, ...], beside: int, row_step: int
) -> npt.NDArray[np.int32]:
    """Number of the line that each pixel is next to, flat, -1 for none; one entry more: nowhere.

    Parameters
    ----------
    row, column : ndarray, shape (lines,)
        Where the lines lie.
    shape : tuple of int
        Height and width of the grid.
    beside : int
        Pixels to either side of a line that are its own.
    row_step : int
        Rows from line to line, as many of which are a line's own.
    """
    above = (row_step - 1) // 2
    near = np.full((above + shape[0] + row_step, shape[1]), -1, np.int32)
    x = np.rint(column).astype(np.int64)
    number = np.arange(len(x), dtype=np.int32)
    for step in range(-beside, beside + 1):
        inside = (x + step >= 0) & (x + step < shape[1])
        for down in range(row_step):
            near[row[inside] + down, x[inside] + step] = number[inside]
    return np.append(near[above : above + shape[0]].reshape(-1), np.int32(-1))
