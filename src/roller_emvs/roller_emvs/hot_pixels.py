"""Pixels that fire on their own, apart from those that see something."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from roller_core.events import EventArray

#: Neighbours along a row or column that a pixel is compared with, px.
_NEAR_PX = 41
#: A hot pixel has so many events more than so many times its neighbours' mean.
_LEAST, _TIMES = 12.0, 4.0


def hot_pixels(events: EventArray, shape: tuple[int, int]) -> npt.NDArray[np.bool_] | None:
    """Pixels with many more events than those beside them; None if there are none.

    As the sensor travels, pixels beside each other along the roll see the same, one after the
    other. One that goes on firing more than they do sees nothing, and its events would make a
    trail over all planes.

    Parameters
    ----------
    events : EventArray
        Of a window.
    shape : tuple of int
        Rows and columns of the image.
    """
    counts = np.zeros(shape, np.float32)
    _tally(events.x, events.y, counts)
    if counts.max() <= _LEAST:
        return None
    near = np.maximum(cv2.blur(counts, (_NEAR_PX, 1)), cv2.blur(counts, (1, _NEAR_PX)))
    hot = counts > _TIMES * near + _LEAST
    return hot if hot.any() else None


@njit(cache=True, nogil=True)
def _tally(x, y, counts):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        counts[y[i], x[i]] += 1
