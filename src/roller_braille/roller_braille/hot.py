"""Pixels that fire on their own, told from those that see something."""

from __future__ import annotations

import cv2
import numpy as np

from roller_core.events import EventArray

from . import _kernels as kernels
from .warp import F32, OUTSIDE

#: Frames between two looks at the counts, at first and later on.
_FRAMES, _EARLY, _FRAMES_LATER = 5, 20, 25
#: Neighbours along the roll that a pixel is compared with, px.
_NEAR_PX = 41
#: A hot pixel has so many events more than so many times its neighbours' mean.
_LEAST, _TIMES = 12.0, 4.0


class HotPixels:
    """Keeps the pixel table of the warp free of hot pixels.

    As the surface moves along the rows of the image, pixels beside each other in a row see the
    same, one after the other. One that goes on firing more than they do sees nothing.

    Parameters
    ----------
    table : ndarray of float32, shape (height, width, 2)
        Ideal pixels, as `vote` takes them.
    """

    def __init__(self, table: F32) -> None:
        #: The table without hot pixels.
        self.table = table.copy()
        self._all = table[..., 0].copy()
        self._counts = np.zeros(table.shape[:2], np.float32)
        self._frames = 0
        self._hot = np.zeros(table.shape[:2], np.bool_)
        #: Hot pixels known.
        self.count = 0

    def add(self, events: EventArray) -> None:
        """Take a frame of events of a rolling sensor."""
        kernels._tally(events.x, events.y, self._counts)
        self._frames += 1
        if self._frames % (_FRAMES if self._frames <= _EARLY else _FRAMES_LATER):
            return
        near = cv2.blur(self._counts, (_NEAR_PX, 1))
        hot = self._counts > _TIMES * near + _LEAST
        self.table[self._hot, 0] = self._all[self._hot]
        self.table[hot, 0] = OUTSIDE
        self._hot, self.count = hot, int(hot.sum())
