"""Settings of the depth engine: defaults, ranges and descriptions in one place.

Node parameters, `config/emvs.yaml` and the README's table come from here.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from roller_core.settings import Settings
from roller_core.timing_settings import TimingSettings

from .evidence import EvidenceSettings

Method = Literal["focus", "bma", "left_right", "emvs", "surface"]
#: Methods that make depth maps, as the live graph does.
METHODS: tuple[Method, ...] = ("focus", "bma", "left_right", "emvs")
#: Methods of a replay.
REPLAY_METHODS: tuple[Method, ...] = (*METHODS, "surface")


class DepthSettings(TimingSettings):
    """From events to depth maps. Defaults of the paper's methods are the paper's."""

    method: Method = Field(
        "focus",
        description="focus: neighbourhood evidence (default); emvs: one volume, middle reference; "
        "left_right: start and end views; bma: start, middle and end views, weighted (paper); "
        "surface: a strip fixed to the surface, no depth maps (live it has a node of its own).",
    )
    window: Literal["auto", "time", "travel", "all"] = Field(
        "auto",
        description="What a window of events spans: a time (paper), a travel of the sensor, or "
        "all of the recording; auto takes travel for focus and time for the paper's methods.",
    )
    window_s: float = Field(0.02, ge=0.0005, le=10.0, description="Window length in time, s.")
    window_travel_m: float = Field(
        0.020, ge=0.0005, le=0.1, description="Window length in travel of the sensor, m."
    )
    max_window_s: float = Field(
        2.0,
        ge=0.01,
        le=60.0,
        description="A window by travel that takes longer than this (standstill) is given up, s.",
    )
    window_overlap: float = Field(
        0.0, ge=0.0, le=0.9, description="Share of a window that the next one repeats."
    )
    depth_min_m: float = Field(0.043, gt=0.0, le=100.0, description="Nearest depth plane, m.")
    depth_max_m: float = Field(0.047, gt=0.0, le=100.0, description="Farthest depth plane, m.")
    prior_margin_m: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Search only this far beyond the depths of the window before, as long as few "
        "depths lie at the ends; 0 searches the whole range, m.",
    )
    patch_half_length_m: float = Field(
        0.0,
        ge=0.0,
        le=10.0,
        description="Events further than this from the camera's axis along the roll are left out, "
        "as the skin doesn't stick to the surface there; 0 takes the whole image, m.",
    )
    plane_rule: Literal["parallax", "fixed"] = Field(
        "parallax",
        description="How many depth planes: as many as the window's parallax tells apart, or "
        "always `planes` (the paper's N_z).",
    )
    planes_per_px: float = Field(
        1.0,
        ge=0.25,
        le=16.0,
        description="Depth planes of the paper's methods per pixel of parallax, evenly in inverse "
        "depth.",
    )
    planes: int = Field(
        500, ge=5, le=65535, description="Depth planes, at most or always (N_z of the paper)."
    )
    plane_spacing: Literal["depth", "inverse_depth"] = Field(
        "depth",
        description="A fixed number of planes is evenly spaced in depth (paper) or in inverse "
        "depth.",
    )
    min_parallax_px: float = Field(
        2.0,
        ge=0.0,
        le=1000.0,
        description="Parallax between nearest and farthest plane below which a window gives no "
        "depth, px.",
    )
    precision: Literal["float32", "float64"] = Field(
        "float32", description="Type of the paper's votes."
    )
    tiles: bool = Field(True, description="Skip parts of the image without events.")
    fast_path: bool = Field(
        True,
        description="Vote once for all reference views where they differ by a shift along the "
        "image's rows alone.",
    )
    fast_path_max_px: float = Field(
        1.0,
        ge=0.0,
        le=10.0,
        description="The reference views are put where that is exact if they move by no more "
        "than this across the way from start to end, or by turning; else every view is voted "
        "for itself, px.",
    )
    packet_events: int = Field(
        256, ge=1, le=65536, description="Events that share the pose of their median event."
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
    weight_rule: Literal["fixed", "inverse_variance"] = Field(
        "fixed",
        description="fixed: the weights as given (paper); inverse_variance: each multiplied, "
        "pixel by pixel, by the inverse of the depth's local variance.",
    )
    threshold_c: float = Field(
        16.0, ge=0.0, le=255.0, description="Adaptive Gaussian threshold: margin C, in 1/255."
    )
    threshold_kernel_px: int = Field(
        5, ge=3, le=255, description="Adaptive Gaussian threshold: size of its window, odd, px."
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
    focus_planes_per_px: float = Field(
        0.5,
        ge=0.25,
        le=16.0,
        description="Depth planes of focus per pixel of parallax; the peak lies between planes.",
    )
    focus_sub_apertures: int = Field(
        1,
        ge=1,
        le=16,
        description="Parts of a window's travel that a coarse depth is the sum of; 1 does without.",
    )
    focus_sigma_px: float = Field(
        5.0, ge=0.5, le=32.0, description="Neighbourhood over which focus sums evidence, px."
    )
    focus_slope_sigma_px: float = Field(
        5.0,
        ge=0.0,
        le=32.0,
        description="Neighbourhood from which focus takes the surface's slope, px; 0 is off.",
    )
    focus_min_confidence: float = Field(
        0.4, ge=0.0, le=1.0, description="Depths of focus with less confidence are left out."
    )
    focus_min_seen_confidence: float = Field(
        0.3,
        ge=0.0,
        le=1.0,
        description="Depths of focus with less confidence, after what is off for having been seen "
        "from one side, are left out.",
    )
    focus_min_point_confidence: float = Field(
        0.25,
        ge=0.0,
        le=1.0,
        description="Points of focus with less confidence, after the scatter around them, are "
        "left out.",
    )
    focus_min_votes: float = Field(
        2.0, ge=0.0, le=1e6, description="Warped events that a pixel of focus needs."
    )
    focus_creep_m: float = Field(
        2.5e-4,
        ge=0.0,
        le=0.01,
        description="Way that edges creep along the surface as their contrast doubles under the "
        "light that travels with the camera; focus corrects depth for it; 0 is off, m.",
    )
    max_backlog_events: int = Field(
        40_000_000,
        ge=10_000,
        le=2_000_000_000,
        description="Events that may wait for processing; beyond it the oldest are dropped, "
        "counted.",
    )
    threads: int = Field(2, ge=1, le=64, description="Threads that share the depth planes.")

    @model_validator(mode="after")
    def _consistent(self) -> DepthSettings:
        if self.depth_min_m >= self.depth_max_m:
            raise ValueError(
                f"depth_min_m = {self.depth_min_m:g} must be less than "
                f"depth_max_m = {self.depth_max_m:g}"
            )
        for name in ("threshold_kernel_px", "median_px"):
            if getattr(self, name) % 2 == 0:
                raise ValueError(f"{name} = {getattr(self, name)} must be odd")
        if len(self.weights) != len(self.reference_views):
            raise ValueError(
                f"{len(self.weights)} weights for {len(self.reference_views)} reference_views"
            )
        if min(self.weights) < 0 or sum(self.weights) <= 0:
            raise ValueError(f"weights {list(self.weights)} must be at least 0 and not all 0")
        if not all(0.0 <= f <= 1.0 for f in self.reference_views):
            raise ValueError(f"reference_views {list(self.reference_views)} must lie in 0–1")
        return self

    @property
    def window_rule(self) -> Literal["time", "travel", "all"]:
        """The window rule in force."""
        if self.window == "auto":
            return "travel" if self.method == "focus" else "time"
        return self.window

    def evidence(self) -> EvidenceSettings:
        """Settings of the evidence that focus sums."""
        return EvidenceSettings.create(
            {
                "sub_apertures": self.focus_sub_apertures,
                "sigma_px": self.focus_sigma_px,
                "slope_sigma_px": self.focus_slope_sigma_px,
                "planes_per_px": self.focus_planes_per_px,
                "max_planes": self.planes,
                "min_confidence": self.focus_min_confidence,
                "min_seen_confidence": self.focus_min_seen_confidence,
                "min_point_confidence": self.focus_min_point_confidence,
                "min_votes": self.focus_min_votes,
                "min_parallax_px": self.min_parallax_px,
                "creep_m": self.focus_creep_m,
                "tiles": self.tiles,
                "threads": self.threads,
            }
        )

    def views(self) -> tuple[tuple[float, float], ...]:
        """(fraction of the window, weight) of the reference views that the method fuses."""
        if self.method == "left_right":
            return ((0.0, 0.5), (1.0, 0.5))
        if self.method == "bma":
            return tuple(zip(self.reference_views, self.weights, strict=True))
        return ((0.5, 1.0),)


class StitcherSettings(Settings):
    """From depth maps to one cloud in `base`."""

    voxel_m: float = Field(
        5e-5, gt=0.0, le=1.0, description="Edge of the voxels in which points are merged, m."
    )
    min_confidence: float = Field(
        0.0, ge=0.0, le=1.0, description="Points of less confidence are left out."
    )
    icp: bool = Field(True, description="Refine each depth map's pose against the cloud by ICP.")
    icp_max_correction_m: float = Field(
        5e-5,
        gt=0.0,
        le=1.0,
        description="An ICP correction that moves a point further than this is refused, m.",
    )
    icp_max_distance_m: float = Field(
        3e-4, gt=0.0, le=1.0, description="Points further apart than this don't correspond, m."
    )
    icp_min_conditioning: float = Field(
        0.01,
        ge=0.0,
        le=1.0,
        description="Smallest to largest eigenvalue of ICP's normal equations below which the "
        "geometry doesn't fix the pose and the correction is refused.",
    )
    icp_min_gain: float = Field(
        0.05,
        ge=0.0,
        le=1.0,
        description="Share by which ICP must lower the residual for its result to be taken.",
    )
    icp_points: int = Field(
        4000, ge=100, le=1_000_000, description="Points of a depth map that ICP uses at most."
    )
    outlier_radius_m: float = Field(
        0.0,
        ge=0.0,
        le=10.0,
        description="Radius of the outlier filter on each depth map; 0 is off, m.",
    )
    outlier_neighbours: int = Field(
        3, ge=1, le=1000, description="Neighbours within the radius that a point needs to stay."
    )
    surface_z_m: float = Field(
        0.0,
        ge=-1e4,
        le=1e4,
        description="Height of the nominal surface in base; `height` of a point counts from it, m.",
    )
    max_voxels: int = Field(
        3_000_000,
        ge=1000,
        le=1_000_000_000,
        description="Voxels under work at most; beyond it the oldest are settled early.",
    )
