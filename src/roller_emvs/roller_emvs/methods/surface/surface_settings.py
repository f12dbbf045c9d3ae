"""Settings of the sweep in the surface's frame."""

from __future__ import annotations

from pydantic import Field

from roller_core.frame_settings import NominalSurface
from roller_emvs.evidence.evidence_settings import SurfaceEvidence
from roller_emvs.method_settings import MethodSettings


class SurfaceSettings(MethodSettings, NominalSurface):
    """From events to points of the surface, without depth maps."""

    block_m: float = Field(
        0.008,
        ge=0.001,
        le=1.0,
        description="Length along the roll of what is computed at once, m; up to four times "
        "as much where there are few events.",
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
    evidence: SurfaceEvidence = Field(
        SurfaceEvidence.create({}), description="What counts as evidence of a depth."
    )
