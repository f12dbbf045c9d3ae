"""Pixels that fire on their own, as against those that see something."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from . import numba_start  # noqa: F401 (before a kernel runs)
from .events import EventArray

#: Neighbours along a row or column that a pixel is compared with, px.
_NEAR_PX = 41
#: A hot pixel has so many events more than so many times its neighbours' mean.
_LEAST, _TIMES = 12.0, 4.0
#: Pixels with so many events below which they are compared one by one.
_FEW = 1000


def count_events(events: EventArray, counts: npt.NDArray[np.float32]) -> None:
    """Add a pixel's events to its count.

    Parameters
    ----------
    events : EventArray
        Events inside the image.
    counts : ndarray of float32, shape (height, width)
        Counted into.

    Raises
    ------
    EventArrayError
        If one lies outside the image.
    """
    events.check_inside(counts.shape[1], counts.shape[0])
    _count(events.x, events.y, counts)


def find_hot_pixels(
    counts: npt.NDArray[np.float32], columns_too: bool
) -> npt.NDArray[np.bool_] | None:
    """Pixels with many more events than those beside them; None if there are none.

    As the sensor travels, pixels beside each other along the roll see the same, one after the
    other. One that goes on firing more than they do sees nothing, and its events would make a
    trail.

    Parameters
    ----------
    counts : ndarray of float32, shape (height, width)
        Events by pixel; see `count_events`.
    columns_too : bool
        Whether the sensor may travel along the columns of the image as well as along its rows.

    Returns
    -------
    ndarray of bool, shape (height, width), or None
    """
    busy = np.flatnonzero(counts > _LEAST)
    if not len(busy):
        return None
    if len(busy) < _FEW:
        hot = np.zeros(counts.shape, np.bool_)
        rows, columns = np.unravel_index(busy, counts.shape)
        near = _mean_beside(counts, rows, columns)
        if columns_too:
            near = np.maximum(near, _mean_beside(counts.T, columns, rows))
        hot[rows, columns] = counts[rows, columns] > near * _TIMES + _LEAST
    else:
        near = cv2.blur(counts, (_NEAR_PX, 1))
        if columns_too:
            np.maximum(near, cv2.blur(counts, (1, _NEAR_PX)), out=near)
        near *= np.float32(_TIMES)
        near += np.float32(_LEAST)
        hot = counts > near
    return hot if hot.any() else None


def _mean_beside(
    counts: npt.NDArray[np.float32], rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64]
) -> npt.NDArray[np.float32]:
    """Mean of the neighbours of some pixels along their row, as `cv2.blur` has it."""
    last = counts.shape[1] - 1
    beside = np.abs(columns[:, None] + np.arange(_NEAR_PX) - _NEAR_PX // 2)
    beside = np.clip(last - np.abs(last - beside), 0, last)  # reflected at the border
    return counts[rows[:, None], beside].mean(axis=1)


@njit(cache=True, nogil=True)
def _count(x, y, counts):  # type: ignore[no-untyped-def]
    """Count events by pixel. x, y: uint16 (n,); counts: float32 (h, w)."""
    for i in range(len(x)):
        counts[y[i], x[i]] += 1.0
