"""Frame names that several nodes take as parameters."""

from __future__ import annotations

from pydantic import Field

from roller_core.settings import Settings


class FrameSettings(Settings):
    """Frames from the robot's base to the camera."""

    base_frame: str = Field("base", description="Frame that surfaces are given in.")
    moving_frame: str = Field(
        "tool0_controller", description="Frame that the robot moves in base (on /tf)."
    )
    sensor_frame: str = Field(
        "event_camera_optical_frame", description="The camera: x right, y down, z forward."
    )
