"""Settings of the sweep in the surface's frame."""

from __future__ import annotations

from pydantic import Field, model_validator

from roller_core.timing_settings import TimingSettings
from roller_emvs.evidence import EvidenceSettings


class SurfaceSettings(EvidenceSettings, TimingSettings):
    """From events to points of the surface, without depth maps."""

    depth_min_m: float = Field(0.043, gt=0.0, le=100.0, description="Nearest depth, m.")
    depth_max_m: float = Field(0.047, gt=0.0, le=100.0, description="Farthest depth, m.")
    patch_half_length_m: float = Field(
        0.0,
        ge=0.0,
        le=10.0,
        description="Events further than this from the camera's axis along the roll are left out, "
        "as the skin doesn't stick to the surface there; 0 takes the whole image, m.",
    )
    block_m: float = Field(
        0.004, ge=0.001, le=1.0, description="Length along the roll of what is computed at once, m."
    )
    min_aperture_m: float = Field(
        0.008,
        ge=0.0005,
        le=10.0,
        description="Travel of the camera during which a row must have been in view, m.",
    )
    sub_apertures: int = Field(
        4,
        ge=1,
        le=16,
        description="Parts of the image along the roll that the coarse depth is the sum of; 1 "
        "does without.",
    )
    min_point_confidence: float = Field(
        0.1,
        ge=0.0,
        le=1.0,
        description="Points of less confidence, after the scatter around them, are left out.",
    )
    min_speed_m_s: float = Field(
        0.002,
        ge=0.0,
        le=10.0,
        description="Events while the sensor is slower than this tell nothing and are left out.",
    )
    max_start_s: float = Field(
        2.0,
        ge=0.01,
        le=60.0,
        description="Without motion for this long before a pass its events are given up, s.",
    )
    surface_z_m: float = Field(
        0.0,
        ge=-1e4,
        le=1e4,
        description="Height of the nominal surface in base; `height` of a point counts from it, m.",
    )
    max_backlog_events: int = Field(
        40_000_000,
        ge=10_000,
        le=2_000_000_000,
        description="Events that may wait; beyond it the oldest are dropped, counted.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> SurfaceSettings:
        if self.depth_min_m >= self.depth_max_m:
            raise ValueError(
                f"depth_min_m = {self.depth_min_m:g} must be less than "
                f"depth_max_m = {self.depth_max_m:g}"
            )
        return self
