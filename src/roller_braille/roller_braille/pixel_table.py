"""The warp's table of pixels, without those that fire on their own."""

from __future__ import annotations

import numpy as np

from roller_core.events import EventArray
from roller_core.hot_pixels import count_events, find_hot_pixels

from .warp import F32, OUTSIDE

#: Batches between two looks at the counts: often among the first ones, then seldom.
_EVERY_EARLY, _EARLY, _EVERY = 5, 20, 25


class PixelTable:
    """Keeps the pixel table of the warp free of hot pixels.

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
        self._batches = 0
        #: Hot pixels known.
        self.hot_pixels = 0

    def add(self, events: EventArray) -> None:
        """Take a batch of events of a rolling sensor."""
        count_events(events, self._counts)
        self._batches += 1
        if self._batches % (_EVERY_EARLY if self._batches <= _EARLY else _EVERY):
            return
        hot = find_hot_pixels(self._counts, columns_too=False)
        self.table[..., 0] = self._all if hot is None else np.where(hot, OUTSIDE, self._all)
        self.hot_pixels = 0 if hot is None else int(hot.sum())
