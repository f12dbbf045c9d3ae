"""Scans of the virtual cell, simulated once and shared by all tests and processes of pytest."""

import copy
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import roller_core
import roller_sim
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_recording.reading import open_recording
from roller_sim.bag import write_bag
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.truth import Truth
from roller_sim.truth_files import load_truth

#: Files and folders of tests that simulate or compute for seconds: `make check` leaves them out.
LONG_TESTS = (
    "braille/test_simulated.py",
    "calibration/",
    "emvs/hard/",
    "emvs/test_pipeline.py",
    "emvs/test_savings.py",
    "emvs/test_surface_sweep.py",
    "evaluation/",
    "inspect/test_replay",
)
#: What scans depend on besides their settings.
_SOURCES = [Path(str(package.__file__)).parent for package in (roller_core, roller_sim)]


@dataclass(frozen=True)
class SimulatedScan:
    """A simulated scan as a replay would read it; everything is read when first asked for.

    Parameters
    ----------
    path : Path
        The bag with its truth. Never write into it: other tests read it too.
    """

    path: Path

    @cached_property
    def _read(self) -> tuple[EventArray, PoseTrack, Camera]:
        recording = open_recording(self.path)
        parts = [step.events for step in recording.steps() if len(step.events)]
        return EventArray.concatenate(parts), recording.track, recording.camera

    @property
    def events(self) -> EventArray:
        """All events, ROS time."""
        return self._read[0]

    @property
    def track(self) -> PoseTrack:
        """Poses of the camera in base, as reported."""
        return self._read[1]

    @property
    def camera(self) -> Camera:
        """The calibration."""
        return self._read[2]

    @cached_property
    def truth(self) -> Truth:
        """What is known exactly."""
        return load_truth(self.path)


class Scans:
    """Gives simulated scans by their settings; the fixture `scans`.

    A scan is simulated by whoever asks for it first, also in another process, and kept in
    pytest's cache folder until the simulator's source changes::

        def test_stairs(scans):
            bag = scans.bag("stairs", speed=0.3, camera={"width": 320, "height": 120})
            scan = scans.scan("stairs", speed=0.3, sensor={"threshold": 0.3})
            scan.events, scan.track, scan.camera, scan.truth

    The groups (`scene`, `camera`, `motion`, `sensor`, `light`, `clock`, `packets`, ...) and the
    rest are those of `VirtualCellSettings`. Pictures for people are left out unless
    ``clock={"image_rate_hz": ...}`` asks for them. The same settings are the same scan, however
    they are written: tests that agree on a scan share it. Who uses the fixture is marked `scan`
    by itself.

    Parameters
    ----------
    folder : Path
        Where scans are kept.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / source_hash()
        self._read: dict[Path, SimulatedScan] = {}
        folder.mkdir(parents=True, exist_ok=True)
        with _locked(folder / "lock"):
            self._folder.mkdir(exist_ok=True)
            for other in folder.iterdir():
                if other.is_dir() and other != self._folder:
                    shutil.rmtree(other)

    def bag(self, name: str, /, speed: float = 0.3, **settings: Any) -> Path:
        """Path of a scan's bag, with its truth; see the class. Copy it before changing it.

        Parameters
        ----------
        name : str
            The scene, as in `roller simulate`.
        speed : float
            m/s.
        **settings
            Groups of settings as mappings, and settings that have no group.
        """
        wanted = scan_settings(name, speed, settings)
        text = json.dumps(wanted.model_dump(mode="json"), sort_keys=True)
        key = hashlib.sha256(text.encode()).hexdigest()[:16]
        bag = self._folder / f"{name}_{key}"
        if not bag.exists():
            with _locked(self._folder / f"{bag.name}.lock"):
                if not bag.exists():
                    with TemporaryDirectory(dir=self._folder) as partial:
                        write_bag(VirtualCell(wanted), Path(partial) / bag.name)
                        (Path(partial) / bag.name).rename(bag)
        return bag

    def scan(self, name: str, /, speed: float = 0.3, **settings: Any) -> SimulatedScan:
        """Give a scan with its events in memory, read once by each process; see `bag`."""
        bag = self.bag(name, speed, **settings)
        return self._read.setdefault(bag, SimulatedScan(bag))

    def events(self, name: str, /, speed: float = 0.3, **settings: Any) -> EventArray:
        """Give a scan's events, ROS time; see `bag`."""
        return self.scan(name, speed, **settings).events


def scan_settings(name: str, speed: float, values: Mapping[str, Any]) -> VirtualCellSettings:
    """Settings of the virtual cell for a scan; see `Scans`."""
    values = copy.deepcopy(dict(values))
    values["scene"] = {**values.get("scene", {}), "name": name}
    values["motion"] = {**values.get("motion", {}), "speed": speed}
    values["clock"] = {"image_rate_hz": 0.0, **values.get("clock", {})}
    return VirtualCellSettings.create(values, "scans")


def source_hash() -> str:
    """Hash of all Python that takes part in a simulation."""
    total = hashlib.sha256()
    for folder in _SOURCES:
        for path in sorted(folder.rglob("*.py")):
            total.update(f"{path.relative_to(folder)}\0".encode())
            total.update(path.read_bytes())
    return total.hexdigest()[:16]


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a lock among processes."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
