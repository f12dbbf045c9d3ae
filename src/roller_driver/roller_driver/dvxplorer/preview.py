"""A picture of the newest events, for people."""

from __future__ import annotations

import threading

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray

from . import _kernels, protocol

_GREY = 128
_STEP = 48


class Preview:
    """Accumulates events: brighter for ON, darker for OFF, grey for none."""

    def __init__(self, width: int = protocol.WIDTH, height: int = protocol.HEIGHT) -> None:
        self._sum = np.zeros((height, width), np.int16)
        self._lock = threading.Lock()

    def add(self, events: EventArray) -> None:
        """Take events."""
        with self._lock:
            _kernels._accumulate(events.x, events.y, events.p, self._sum)

    def take(self) -> npt.NDArray[np.uint8]:
        """The picture since the last call, uint8, shape (height, width)."""
        with self._lock:
            total = self._sum.copy()
            self._sum[:] = 0
        return np.clip(_GREY + _STEP * np.clip(total, -3, 3), 0, 255).astype(np.uint8)
