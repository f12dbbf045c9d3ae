"""Settings of the sweep in the surface's frame."""

from __future__ import annotations

from pydantic import Field

from roller_emvs.evidence import EvidenceSettings
from roller_emvs.method_settings import MethodSettings


class SurfaceSettings(MethodSettings):
    """From events to points of the surface, without depth maps."""

    block_m: float = Field(
        0.008, ge=0.001, le=1.0, description="Length along the roll of what is computed at once, m."
    )
    min_aperture_m: float = Field(
        0.008,
        ge=0.0005,
        le=10.0,
        description="Travel of the camera during which a row must have been in view, m.",
    )
    min_speed_m_s: float = Field(
        0.002,
        ge=0.0,
        le=10.0,
        description="Events while the sensor is slower than this are left out: they show nothing.",
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
    # Contrast reads lower where all events vote on all planes; 0.25 in place of 0.3 is tuned on the
    # virtual cell (demo at 0.5 m/s: as many edges as with rays).
    evidence: EvidenceSettings = Field(
        EvidenceSettings.create({"min_confidence": 0.25, "min_point_confidence": 0.1}),
        description="What counts as evidence of a depth.",
    )
