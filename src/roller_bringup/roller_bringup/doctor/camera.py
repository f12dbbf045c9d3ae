"""The event camera: there, known, and not held by another program."""

from __future__ import annotations

from dataclasses import dataclass

from roller_driver.dvxplorer.backends import load_backend
from roller_driver.dvxplorer.discovery import open_camera
from roller_driver.dvxplorer.errors import (
    BackendError,
    CameraBusyError,
    CameraFault,
    CameraNotFoundError,
)

from .result import Level, Result, ok


@dataclass(frozen=True)
class CameraFacts:
    """A camera that answers as a known one does."""

    name: str
    firmware: int


def find_camera(serial: str = "", backend: str = "") -> CameraFacts | CameraFault:
    """Open the camera, ask it who it is and let it go; or what keeps one from that.

    Parameters
    ----------
    serial : str
        Serial number; empty: the first camera.
    backend : str
        See `roller_driver.dvxplorer.backends.load_backend`.
    """
    try:
        camera = open_camera(load_backend(backend), serial)
    except CameraFault as fault:
        return fault
    try:
        camera.identify()
    except CameraFault as fault:
        return fault
    finally:
        camera.let_go()
    return CameraFacts(camera.name, camera.firmware)


def judge_camera(found: CameraFacts | CameraFault, asked: bool = False) -> Result:
    """Whether the driver will stream."""
    name = "camera"
    if isinstance(found, CameraFacts):
        return ok(name, f"{found.name}, firmware {found.firmware}")
    missing = isinstance(found, CameraNotFoundError | CameraBusyError | BackendError)
    level: Level = "warning" if missing and not asked else "fault"
    text = str(found)
    if isinstance(found, CameraNotFoundError):
        advice = "plug it in; without one, the virtual cell takes its place (`make demo`)"
    elif isinstance(found, CameraBusyError):
        advice = "if that is the node event_camera all is well; else stop the other program"
    else:
        # The driver's faults say what to do.
        text, _, advice = text.partition("; ")
    return Result(name=name, level=level, found=text, advice=advice)
