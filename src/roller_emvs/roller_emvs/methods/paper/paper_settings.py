"""Settings of the paper's methods."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from roller_core.settings import Settings


class PaperSettings(Settings):
    """From votes to depth by `emvs`, `left_right` and `bma`; defaults are the paper's."""

    plane_rule: Literal["parallax", "fixed"] = Field(
        "parallax",
        description="How many depth planes: one a pixel of the window's parallax, evenly in "
        "inverse depth, or always `planes`, evenly in depth (the paper's N_z).",
    )
    planes: int = Field(
        500, ge=5, le=65535, description="Depth planes, at most or always (N_z of the paper)."
    )
    reference_views: tuple[float, ...] = Field(
        (0.0, 0.5, 1.0),
        min_length=1,
        max_length=9,
        description="Reference views of bma as fractions of the window: start, middle, end.",
    )
    weights: tuple[float, ...] = Field(
        (0.445, 0.333, 0.222),
        min_length=1,
        max_length=9,
        description="Weights of the reference views of bma, in their order.",
    )
    threshold_c: float = Field(
        16.0, ge=0.0, le=255.0, description="Adaptive Gaussian threshold: margin C, in 1/255."
    )
    full_scale_votes: float = Field(
        32.0,
        ge=0.0,
        le=1e6,
        description="Votes that count as 255 for the threshold, whatever the window holds; "
        "0 scales by each window's own extremes, as the reference C++ code does.",
    )
    median_px: int = Field(
        45, ge=1, le=255, description="Masked median filter G_f: size, odd, px; 1 is off."
    )

    @model_validator(mode="after")
    def _consistent(self) -> PaperSettings:
        if self.median_px % 2 == 0:
            raise ValueError(f"median_px = {self.median_px} must be odd")
        if len(self.weights) != len(self.reference_views):
            raise ValueError(
                f"{len(self.weights)} weights for {len(self.reference_views)} reference_views"
            )
        if min(self.weights) < 0 or sum(self.weights) <= 0:
            raise ValueError(f"weights {list(self.weights)} must be at least 0 and not all 0")
        if not all(0.0 <= f <= 1.0 for f in self.reference_views):
            raise ValueError(f"reference_views {list(self.reference_views)} must lie in 0–1")
        return self
