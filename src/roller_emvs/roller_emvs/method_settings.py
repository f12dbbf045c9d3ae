"""Settings that every method of depth takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field, model_validator

from roller_core.timing_settings import TimingSettings

from .lines.edge_drift import EdgeDriftSettings

if TYPE_CHECKING:
    from typing import Self


class MethodSettings(TimingSettings):
    """Where depth is looked for, and with how much of the machine."""

    depth_min_m: float = Field(0.043, gt=0.0, le=100.0, description="Nearest depth, m.")
    depth_max_m: float = Field(0.047, gt=0.0, le=100.0, description="Farthest depth, m.")
    patch_half_length_m: float = Field(
        0.0,
        ge=0.0,
        le=10.0,
        description="Events further than this from the camera's axis along the roll are left out, "
        "as the skin doesn't stick to the surface there; 0 takes the whole image, but for ends "
        "that a printed texture shows to be off the surface, m.",
    )
    max_still_s: float = Field(
        2.0,
        ge=0.01,
        le=60.0,
        description="Events are given up where the sensor doesn't move for this long, or takes "
        "longer than this for a window by travel, s.",
    )
    average_flats: bool = Field(
        True,
        description="Under a printed texture, whether points of flat places follow a wider "
        "neighbourhood, of focus and surface. Inspection takes points as they are found, as it "
        "averages by itself.",
    )
    threads: int = Field(2, ge=1, le=64, description="Threads that share the work.")
    edge_drift: EdgeDriftSettings = Field(
        EdgeDriftSettings.create({}),
        description="The instrument's drift of edges, of focus and surface; see `roller calibrate "
        "edge-drift`.",
    )

    @model_validator(mode="after")
    def _near_before_far(self) -> Self:
        if self.depth_min_m >= self.depth_max_m:
            raise ValueError(
                f"depth_min_m = {self.depth_min_m:g} must be less than "
                f"depth_max_m = {self.depth_max_m:g}"
            )
        return self
