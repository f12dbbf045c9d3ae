"""Settings of the sweep in the surface's frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field, model_validator

from roller_core.frame_settings import NominalSurface
from roller_emvs.evidence.evidence_settings import SurfaceEvidence
from roller_emvs.method_settings import MethodSettings

if TYPE_CHECKING:
    from typing import Self


#: Farthest depth, in the nearest, that one grid on the surface suits.
_WIDEST = 6.0


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

    @model_validator(mode="after")
    def _one_grid(self) -> Self:
        if self.depth_max_m > _WIDEST * self.depth_min_m:
            raise ValueError(
                f"depth_max_m = {self.depth_max_m:g} is more than {_WIDEST:g} times as far as "
                f"depth_min_m = {self.depth_min_m:g}: set them around the surface"
            )
        return self
