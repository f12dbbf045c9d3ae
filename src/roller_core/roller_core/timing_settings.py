"""Settings of whatever puts events beside poses."""

from __future__ import annotations

from pydantic import Field

from .settings import Settings

#: Poses that lie further apart leave a gap, unless a user says otherwise, s.
DEFAULT_MAX_POSE_GAP_S = 0.1


class PoseGapSettings(Settings):
    """How far apart poses may lie."""

    max_pose_gap_s: float = Field(
        DEFAULT_MAX_POSE_GAP_S,
        ge=0.001,
        le=10.0,
        description="Longest time between two poses to interpolate over, s.",
    )


class WaitingSettings(Settings):
    """How much may wait."""

    max_waiting_mb: float = Field(
        512.0,
        ge=0.1,
        le=1e6,
        description="Memory for event packets that wait to be decoded, 10⁶ bytes, and as much for "
        "decoded events that wait for poses (16 bytes each); beyond it a stretch of the oldest is "
        "left out, counted, and so are the windows that it touches.",
    )

    @property
    def max_waiting_events(self) -> int:
        """Decoded events that may wait."""
        return round(self.max_waiting_mb * 1e6 / 16)


class TimingSettings(PoseGapSettings, WaitingSettings):
    """How the times of events and poses go together."""

    event_delay_s: float = Field(
        0.0,
        ge=-0.1,
        le=0.1,
        description="Event stamps less the time, in the clock of the poses, of what they show: "
        "what `roller calibrate time-offset` finds, s.",
    )
