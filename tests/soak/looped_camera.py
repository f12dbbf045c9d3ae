"""An emulated camera that sees the same scan over and over, and obeys files."""

import json
import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from driver.emulation.camera_model import _later
from driver.emulation.paced_camera import PacedCamera
from driver.emulation.usb_backend import EmulatedBackend

VARIABLE = "SOAK_CAMERA"
#: What the camera itself keeps while nobody reads, s; older frames are lost in it.
_KEPT_S = 0.2


@dataclass
class LoopedCamera(PacedCamera):
    """Begins its scan again every `period_s`.

    Parameters
    ----------
    period_s : float
        From scan to scan.
    folder : str
        While `unplugged` is in it, the camera isn't there. A file `step` makes its clock leap by
        the milliseconds that it holds.
    """

    period_s: float = 1.0
    folder: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._loop = 0
        threading.Thread(target=self._obey, daemon=True).start()

    def _obey(self) -> None:
        away, step = Path(self.folder) / "unplugged", Path(self.folder) / "step"
        while True:
            time.sleep(0.05)
            if away.exists() and self.plugged:
                self.unplug()
            elif not away.exists() and not self.plugged:
                self.plug()
            if step.exists():
                with self._changed:
                    self.stream = _later(self.stream, int(step.read_text()))
                step.unlink()

    def _ready(self, size: int) -> int:
        if self._start_s is None:
            self._start_s = float(Path(self.start_file).read_text())
        loop, now = divmod(time.monotonic() - self._start_s, self.period_s)
        if loop != self._loop:
            self.stream = _later(self.stream, round((loop - self._loop) * self.period_s * 1e3))
            self._loop, self._position = int(loop), 0
        lost = int(np.searchsorted(self._due_s, now - _KEPT_S))
        if lost and self._position < (oldest := int(self._ends[lost - 1])):
            self._position = oldest
        sent = int(np.searchsorted(self._due_s, now, side="right"))
        end = int(self._ends[sent - 1]) if sent else 0
        return max(min(size, end - self._position), 0) if self.streaming else 0


def from_environment() -> EmulatedBackend:
    """A backend with the camera that the environment describes, for parameter `backend`."""
    given = json.loads(os.environ[VARIABLE])
    words = np.fromfile(given.pop("words"), "<u4")
    return EmulatedBackend(LoopedCamera(words.tobytes(), **given))
