"""Frame names that several nodes take as parameters."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from roller_core.sensor_pose import DEFAULT_SMOOTHING
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


def smoothing_field(default: int) -> Any:
    """The parameter `pose_smoothing`, with a node's own default."""
    return Field(
        default,
        ge=0,
        le=100,
        description="Poses on either side over which the time stamps of the robot's poses are "
        "smoothed where their rate is steady; 0 takes stamps as they come.",
    )


class FollowedFrames(FrameSettings):
    """Frames of a node that follows the robot's poses."""

    pose_smoothing: int = smoothing_field(DEFAULT_SMOOTHING)
