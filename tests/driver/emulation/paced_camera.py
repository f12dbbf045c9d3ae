"""The camera's model sending each read-out frame when its time comes, as a camera does."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .camera_model import CameraModel
from .camera_words import START, Words, is_reference


@dataclass
class PacedCamera(CameraModel):
    """A camera whose stream keeps time.

    Parameters
    ----------
    first_us : int
        What its clock shows when the stream begins.
    clock_ppm : float
        How much faster than true time its clock runs.
    hold_s : float
        A transfer goes out when it is full or its first word has waited for so long.
    start_file : str
        Holds the time of the stream's begin, s of CLOCK_MONOTONIC; nothing is sent before the
        file is there.
    """

    first_us: int = 0
    clock_ppm: float = 0.0
    hold_s: float = 0.001
    start_file: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._ends, self._due_s = release_times(
            np.frombuffer(self.stream, "<u4"), self.first_us, self.clock_ppm
        )
        self._start_s: float | None = None

    def _ready(self, size: int) -> int:
        if self._start_s is None:
            path = Path(self.start_file)
            if not path.is_file():
                return 0
            self._start_s = float(path.read_text())
        now = time.monotonic() - self._start_s
        frames = int(np.searchsorted(self._due_s, now, side="right"))
        end = int(self._ends[frames - 1]) if frames else 0
        if end <= self._position:
            return 0
        oldest = int(np.searchsorted(self._ends, self._position, side="right"))
        waited = now - float(self._due_s[oldest])
        if end - self._position < size and waited < self.hold_s and end < len(self.stream):
            return 0
        return super()._ready(min(size, end - self._position))


def release_times(
    words: Words, first_us: int, clock_ppm: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Where each frame ends in the stream, bytes, and when it is sent, s after the begin."""
    reference = is_reference(words)
    ms = np.where(reference, words & np.uint32(0x3FFFFF), 0).astype(np.int64)
    newest = np.maximum.accumulate(np.where(reference, np.arange(len(words)), 0))
    starts = np.flatnonzero(((words >> np.uint32(26)) == 1) & ((words & START) != 0))
    sub = (words[starts] >> np.uint32(11)).astype(np.int64) & 0x3FF
    t_us = ms[newest[starts]] * 1000 + sub
    begins = starts - reference[starts - 1]
    ends = np.append(begins[1:], len(words)) * 4
    return ends.astype(np.int64), (t_us - first_us) * 1e-6 / (1 + clock_ppm * 1e-6)
