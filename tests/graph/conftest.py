from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from driver.emulation import usb_backend
from driver.emulation.camera_words import encode_words
from graph.graph_world import Processes, Watcher
from roller_core.events import EventArray


@pytest.fixture
def processes(domain: int, tmp_path: Path) -> Iterator[Processes]:
    """Nodes; those that still run at the end are stopped."""
    made = Processes(tmp_path)
    yield made
    made.stop()


@pytest.fixture
def watch(domain: int) -> Iterator[Callable[..., Watcher]]:
    """Make a watcher of the topics named."""
    made: list[Watcher] = []

    def make(*names: str) -> Watcher:
        made.append(Watcher(names))
        return made[-1]

    yield make
    for watcher in made:
        watcher.close()


@pytest.fixture
def emulated_camera(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> EventArray:
    """Half a second of events, sent over and over at the pace of their times."""
    rng = np.random.default_rng(1)
    frames, each = 2500, 40
    pixels = rng.integers(0, 640 * 480, (frames, each))
    t_us = np.repeat(1_000_000 + 200 * np.arange(frames), each)
    events = EventArray.from_arrays(
        pixels.ravel() % 640, pixels.ravel() // 640, t_us * 1000, rng.integers(0, 2, frames * each)
    )
    words = encode_words(events)
    words.tofile(tmp_path / "words.u4")
    monkeypatch.setenv(usb_backend.EVENTS_VARIABLE, str(tmp_path / "words.u4"))
    monkeypatch.setenv(usb_backend.RATE_VARIABLE, str(2 * words.nbytes))
    monkeypatch.setenv(usb_backend.REPEAT_VARIABLE, "500")
    return events
