"""Settings of whatever puts events beside poses."""

from __future__ import annotations

from pydantic import Field

from .settings import Settings


class PoseGapSettings(Settings):
    """How far apart poses may lie."""

    max_pose_gap_s: float = Field(
        0.1, ge=0.001, le=10.0, description="Longest time between two poses to interpolate over, s."
    )


class TimingSettings(PoseGapSettings):
    """How the times of events and poses go together."""

    event_delay_s: float = Field(
        0.0,
        ge=-0.1,
        le=0.1,
        description="Event stamps less the time, in the clock of the poses, of what they show: "
        "what `roller calibrate --time-offset` finds, s.",
    )
