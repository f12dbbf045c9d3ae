"""What can be wrong with an event camera, each with what to do about it."""

from __future__ import annotations

from roller_core.errors import RollerError


class CameraFault(RollerError):
    """Base of the event camera's faults."""


class CameraNotFoundError(CameraFault):
    """No camera of ours is plugged in, or none with the serial number asked for."""


class WrongDeviceError(CameraFault):
    """A device has the camera's USB ids but is another model."""


class UnknownFirmwareError(CameraFault):
    """The camera's firmware or logic speaks a protocol that isn't known."""


class CameraPermissionError(CameraFault):
    """The user may not open the device."""


class CameraBusyError(CameraFault):
    """Another program holds the camera."""


class EndpointMissingError(CameraFault):
    """The camera has no bulk endpoint for events."""


class CameraControlError(CameraFault):
    """The camera refused or didn't answer a control request."""


class CameraLostError(CameraFault):
    """The camera went away or its stream broke while it ran."""


class BackendError(CameraFault):
    """The USB library or the backend that a parameter names can't be loaded."""
