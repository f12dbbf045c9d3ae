"""Settings of the evidence that `focus` and `surface` share."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import Field

from roller_core.settings import Settings


def confidence_field(default: float) -> Any:
    """The parameter `min_confidence`, with a method's own default."""
    return Field(
        default,
        ge=0.0,
        le=1.0,
        description="Depths whose peak stands out less than this are left out. Tuned on the "
        "virtual cell.",
    )


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
    min_confidence: float = confidence_field(0.3)
    #: The same, after what is off for having been seen from one side; and for points, after what is
    #: off for the scatter around them. Tuned on the virtual cell.
    min_seen_confidence: ClassVar[float] = 0.0
    min_point_confidence: ClassVar[float] = 0.0
    #: Where points lack so many times of a wider surface what they usually do, it errs itself.
    strong_relief: ClassVar[float] = 5.0


class FocusEvidence(EvidenceSettings):
    """Evidence for `focus`."""

    min_confidence: float = confidence_field(0.4)
    min_seen_confidence: ClassVar[float] = 0.3
    min_point_confidence: ClassVar[float] = 0.25
    # In one window relief stands out less. Tuned on the virtual cell.
    strong_relief: ClassVar[float] = 3.0


class SurfaceEvidence(EvidenceSettings):
    """Evidence for `surface`."""

    # Contrast reads lower where all events vote on all planes; 0.25 in place of 0.3 is tuned on the
    # virtual cell (demo at 0.5 m/s: as many edges as with rays).
    min_confidence: float = confidence_field(0.25)
    min_point_confidence: ClassVar[float] = 0.1
