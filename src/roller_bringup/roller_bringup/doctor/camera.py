"""The event camera: there, known, and not held by another program."""

from __future__ import annotations

from roller_driver.dvxplorer.backends import load_backend
from roller_driver.dvxplorer.discovery import open_camera
from roller_driver.dvxplorer.errors import (
    BackendError,
    CameraBusyError,
    CameraFault,
    CameraNotFoundError,
)

from .result import Result, ok


def check_camera(serial: str = "", backend: str = "", asked: bool = False) -> Result:
    """Open the camera, ask it who it is and close it.

    Parameters
    ----------
    serial : str
        Serial number; empty: the first camera.
    backend : str
        See `roller_driver.dvxplorer.backends.load_backend`.
    asked : bool
        Whether a camera must be there.
    """
    try:
        camera = open_camera(load_backend(backend), serial)
        try:
            camera.identify()
        finally:
            camera.let_go()
    except CameraFault as error:
        return _judge(error, asked)
    return ok("camera", f"{camera.name}, firmware {camera.firmware}")


def _judge(error: CameraFault, asked: bool) -> Result:
    missing = isinstance(error, CameraNotFoundError | CameraBusyError | BackendError)
    # The driver's faults say what to do.
    text, _, advice = str(error).partition("; ")
    if isinstance(error, CameraNotFoundError):
        text = str(error)
        advice = "plug it in; without one, the virtual cell takes its place (`make demo`)"
    elif isinstance(error, CameraBusyError):
        text = str(error)
        advice = "if that is the node event_camera all is well; else stop the other program"
    return Result("camera", "warning" if missing and not asked else "fault", text, advice)
