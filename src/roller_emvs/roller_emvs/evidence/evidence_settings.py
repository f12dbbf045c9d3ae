"""Settings of the evidence that `focus` and `surface` share."""

from __future__ import annotations

from pydantic import Field

from roller_core.settings import Settings


class EvidenceSettings(Settings):
    """From rays to the depth at which they are sharpest."""

    sub_apertures: int = Field(
        1,
        ge=1,
        le=16,
        description="Parts of the aperture that a coarse depth is the sum of; 1 does without.",
    )
    coarse_sigma_px: float = Field(
        8.0, ge=0.5, le=32.0, description="Neighbourhood of the coarse depth, px."
    )
    min_coarse_confidence: float = Field(
        0.2,
        ge=0.0,
        le=1.0,
        description="Where the coarse depth has less confidence, as in noise or where several "
        "depths fit alike, there is no depth.",
    )
    sigma_px: float = Field(
        5.0, ge=0.5, le=32.0, description="Neighbourhood of the fine depth, px."
    )
    planes_per_px: float = Field(
        0.5, ge=0.25, le=16.0, description="Planes per pixel of parallax, coarse and fine."
    )
    max_planes: int = Field(500, ge=5, le=65535, description="Most planes.")
    search_px: float = Field(
        8.0,
        ge=1.0,
        le=1000.0,
        description="The fine depth is searched this many pixels of parallax to either side of "
        "the coarse one.",
    )
    slope_sigma_px: float = Field(
        5.0,
        ge=0.0,
        le=32.0,
        description="Neighbourhood from which the surface's slope is taken, px; 0 is off.",
    )
    min_confidence: float = Field(
        0.3, ge=0.0, le=1.0, description="Evidence of less confidence is left out."
    )
    min_seen_confidence: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Evidence is left out that has less confidence, after what is off for having "
        "been seen from a part of the aperture alone.",
    )
    min_point_confidence: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Points of less confidence, after the scatter around them, are left out.",
    )
    max_rival: float = Field(
        0.9,
        ge=0.0,
        le=2.0,
        description="Depths are left out where another peak of evidence reaches this share of "
        "the highest.",
    )
    min_votes: float = Field(
        2.0, ge=0.0, le=1e6, description="Warped events that a pixel needs to become a point."
    )
    creep_m: float = Field(
        2.5e-4,
        ge=0.0,
        le=0.01,
        description="Way that edges creep along the surface as their contrast doubles under the "
        "light that travels with the camera; corrects depth where contrast changes; 0 is off, m.",
    )
    dead_time_s: float = Field(
        2e-4,
        ge=0.0,
        le=0.1,
        description="Time that a pixel is blind after an event, as it waits for its read-out, s.",
    )
    creep_polarity: int = Field(
        0,
        ge=0,
        le=1,
        description="Polarity of the edges that creep, those where the sensor comes upon a wall: "
        "0 (OFF) where walls look darker than flat surface.",
    )
    min_parallax_px: float = Field(
        2.0,
        ge=0.0,
        le=1000.0,
        description="Parallax over the depth range below which there is no depth, px.",
    )
    tiles: bool = Field(True, description="Skip parts of the image without events.")
    threads: int = Field(2, ge=1, le=64, description="Threads that share the work.")
