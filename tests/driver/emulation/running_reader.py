"""A reader that runs on the camera's model, and events to give it."""

import numpy as np

from driver.emulation.camera_words import in_order
from driver.emulation.usb_backend import EmulatedBackend
from roller_core.events import EventArray
from roller_driver.dvxplorer.camera_settings import SensorSettings
from roller_driver.dvxplorer.discovery import open_camera
from roller_driver.dvxplorer.reader import CameraReader, ReaderSettings
from waiting import wait_until


def scan(n=20_000, frames=300, seed=1, start_us=1_000_000):
    """Events on distinct pixels of read-out frames 200 µs apart."""
    rng = np.random.default_rng(seed)
    pixels = np.concatenate([rng.choice(640 * 480, n // frames, replace=False)
                             for _ in range(frames)])  # fmt: skip
    t = np.repeat(np.arange(frames) * 200 + start_us, n // frames)
    events = EventArray.from_arrays(
        pixels % 640, pixels // 640, t * 1000, rng.integers(0, 2, len(t))
    )
    return in_order(events)


class Running:
    """A reader on a model, and what it handed out."""

    def __init__(self, model, sensor=None, on_failure=None, **settings):
        self.backend, self.sensor = EmulatedBackend(model), sensor or SensorSettings()
        self.packets, self.changes = [], []
        self.reader = CameraReader(
            self._connect, self.packets.append,
            on_change=lambda state, fault: self.changes.append((state, fault)),
            on_failure=on_failure, settings=ReaderSettings(retry_s=0.05, **settings),
        )  # fmt: skip

    def _connect(self):
        camera = open_camera(self.backend)
        camera.configure(self.sensor)
        self.ignored = camera.ignored
        return camera

    def __enter__(self):
        self.reader.start()
        return self

    def __exit__(self, *_):
        self.reader.stop()

    @property
    def events(self):
        return EventArray.concatenate([part.events for part in self.packets])

    def wait(self, condition, timeout_s=10.0):
        wait_until(condition, lambda: (self.reader.status, self.changes), timeout_s)

    def wait_for(self, n):
        self.wait(lambda: sum(len(part.events) for part in self.packets) >= n)


def same(a, b):
    a, b = in_order(a), in_order(b)
    return all(np.array_equal(getattr(a, f), getattr(b, f)) for f in ("x", "y", "t_ns", "p"))
