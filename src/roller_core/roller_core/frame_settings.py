"""What stages take beside the settings of their numerics: frames, poses and the camera they fit."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from .frame_names import BASE_FRAME, CAMERA_FRAME, TOOL_FRAME
from .settings import Settings
from .timing_settings import PoseGapSettings, WaitingSettings

#: Later poses that one waits for, so that its stamp is that of a line through many.
DEFAULT_SMOOTHING = 8


class FrameSettings(Settings):
    """Frames from the robot's base to the camera."""

    base_frame: str = Field(BASE_FRAME, description="Frame that surfaces are given in.")
    moving_frame: str = Field(
        TOOL_FRAME, description="Frame that the robot moves in base (on /tf)."
    )
    sensor_frame: str = Field(CAMERA_FRAME, description="The camera: x right, y down, z forward.")


class RobotFrames(FrameSettings):
    """Frames of a node that publishes the robot's poses."""

    base_frame: str = Field(BASE_FRAME, description="The robot's base, in the controller's axes.")
    moving_frame: str = Field(
        TOOL_FRAME, description="The tool (TCP) as the controller reports it."
    )
    tf_prefix: str = Field(
        "",
        description="Put before base_frame and moving_frame, as the robot's own driver does.",
    )

    @property
    def base(self) -> str:
        """Name of the base's frame."""
        return self.tf_prefix + self.base_frame

    @property
    def tool(self) -> str:
        """Name of the tool's frame."""
        return self.tf_prefix + self.moving_frame


def smoothing_field(default: int) -> Any:
    """The parameter `pose_smoothing`, with a stage's own default."""
    return Field(
        default,
        ge=0,
        le=100,
        description="Later poses that a pose of the robot waits for: its time stamp is that of the "
        "line through theirs and up to 256 earlier ones where their rate is steady. 0 takes stamps "
        "as they come.",
    )


def idle_flush_field(default: float, what: str) -> Any:
    """The parameter `idle_flush_s` of a stage that waits for `what`."""
    return Field(default, ge=0.05, le=60.0, description=f"Without {what}, s.")


class FollowedFrames(FrameSettings, PoseGapSettings):
    """Frames of a stage that follows the robot's poses."""

    pose_smoothing: int = smoothing_field(DEFAULT_SMOOTHING)
    idle_flush_s: float = idle_flush_field(
        0.4,
        "events for this long, or a quarter of it while the robot is at rest, what is left is "
        "processed as it is",
    )


class NominalSurface(Settings):
    """Where the surface should be."""

    surface_z_m: float = Field(
        0.0,
        ge=-1e4,
        le=1e4,
        description="Height of the nominal surface in base, m; `height` of a point counts from it.",
    )


class StreamSettings(FollowedFrames, WaitingSettings):
    """What every stage that takes events has beside its numerics."""

    calibrated_camera: tuple[float, ...] = Field(
        (0.0,),
        description="Camera that the other parameters were calibrated with: width, height, fx, fy, "
        "cx, cy (px), distortion; with another the node refuses to go on. A single 0: any.",
    )
    max_latency_s: float = Field(
        0.0,
        ge=0.0,
        le=3600.0,
        description="Event packets that wait may be this much older than the newest; beyond it a "
        "stretch is left out, as above. 0: all are worked off, however late, s.",
    )
