"""Settings of the evidence that `focus` and `surface` share."""

from __future__ import annotations

from pydantic import Field

from roller_core.settings import Settings


class EvidenceSettings(Settings):
    """From rays to the depth at which they are sharpest."""

    sigma_px: float = Field(
        5.0,
        ge=0.5,
        le=32.0,
        description="Neighbourhood over which evidence is summed, px. Tuned on the virtual cell.",
    )
    planes_per_px: float = Field(
        0.5,
        ge=0.25,
        le=16.0,
        description="Depth planes per pixel of parallax; the peak lies between planes.",
    )
    min_confidence: float = Field(
        0.3,
        ge=0.0,
        le=1.0,
        description="Depths whose peak stands out less than this are left out. This and the next "
        "two were tuned on the virtual cell.",
    )
    min_seen_confidence: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="The same, after what is off for having been seen from one side.",
    )
    min_point_confidence: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="The same for points, after what is off for the scatter around them.",
    )
    min_votes: float = Field(
        2.0, ge=0.0, le=1e6, description="Warped events that a pixel needs to become a point."
    )
