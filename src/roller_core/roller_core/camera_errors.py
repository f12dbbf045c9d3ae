"""What may be wrong with a camera's calibration."""

from __future__ import annotations

from .errors import RollerError


class CameraError(RollerError):
    """A calibration that can't be read or makes no sense."""


class OtherCameraError(CameraError):
    """Something that was calibrated with another camera."""
