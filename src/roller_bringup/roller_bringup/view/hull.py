"""What lies between cells: their convex hull, without what loads OpenCV."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


def cells_in_hull(i: I64, j: I64) -> npt.NDArray[np.bool_]:
    """Which cells lie in the convex hull of some, the least of which are 0 and 0."""
    points = np.zeros((int(j.max()) + 1, int(i.max()) + 1), np.bool_)
    points[j, i] = True
    rows = np.flatnonzero(points.any(axis=1))
    last = points.shape[1] - 1 - points[rows, ::-1].argmax(axis=1)
    left, right = _convex(rows, points[rows].argmax(axis=1)), -_convex(rows, -last)
    columns = np.arange(points.shape[1])
    return (columns >= left[:, None] - 1e-6) & (columns <= right[:, None] + 1e-6)


def _convex(rows: I64, values: I64) -> F64:
    """The greatest convex curve that lies nowhere above values, at every row up to the last."""
    kept: list[tuple[int, int]] = []
    for row, value in zip(rows.tolist(), values.tolist(), strict=True):
        while len(kept) > 1:
            (a, at_a), (b, at_b) = kept[-2:]
            if (at_b - at_a) * (row - a) < (value - at_a) * (b - a):
                break
            kept.pop()
        kept.append((row, value))
    at, known = np.transpose(kept)
    return np.interp(np.arange(rows[-1] + 1), at, known)
