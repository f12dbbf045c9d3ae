"""Settings of the depth engine: defaults, ranges and descriptions in one place.

Node parameters and `config/emvs.yaml` come from here.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from roller_core.frame_settings import NominalSurface
from roller_core.settings import Settings

from .evidence.evidence_settings import FocusEvidence
from .lines.edge_drift import NOT_CORRECTED
from .method_settings import MethodSettings
from .methods.paper.paper_settings import PaperSettings

Method = Literal["focus", "bma", "left_right", "emvs", "surface"]
#: Methods that make depth maps, as the live graph does.
METHODS: tuple[Method, ...] = ("focus", "bma", "left_right", "emvs")
#: Methods of a replay.
REPLAY_METHODS: tuple[Method, ...] = (*METHODS, "surface")


#: What lies at a window's border is seen through half of the aperture: so much of a window by
#: travel comes again in the next one.
TRAVEL_OVERLAP = 0.4
#: Under a printed texture windows of this share of the travel, of which so much comes again, have
#: evidence enough: an eighth more error, for three quarters of the time and memory.
TEXTURED_SHARE, TEXTURED_OVERLAP = 5 / 7, 0.25


class WindowSettings(Settings):
    """How the stream of events is cut into windows, of which each gives a depth map."""

    rule: Literal["auto", "time", "travel", "all"] = Field(
        "auto",
        description="What a window of events spans: a time (paper), a travel of the sensor, or "
        "all of the recording; auto takes travel for focus and time for the paper's methods.",
    )
    time_s: float = Field(0.02, ge=0.0005, le=10.0, description="Length in time, s.")
    travel_m: float = Field(
        0.028,
        ge=0.0005,
        le=0.1,
        description="Length in travel of the sensor, m; after a window under a printed texture "
        "5/7 of it.",
    )
    overlap: float = Field(
        -1.0,
        ge=-1.0,
        le=0.9,
        description="Share of a window that the next one repeats; below 0: two fifths of windows "
        "by travel, a quarter under a printed texture, nothing of those by time.",
    )


class DepthSettings(MethodSettings):
    """From events to depth maps."""

    method: Method = Field(
        "focus",
        description="focus: neighbourhood evidence (default); emvs: one volume, middle reference; "
        "left_right: start and end views; bma: start, middle and end views, weighted (paper); "
        "surface: a strip fixed to the surface, no depth maps (live it has a node of its own).",
    )
    packet_events: int = Field(
        256,
        ge=1,
        le=65536,
        description="Events that share the pose of their median event; with focus fewer where the "
        "image moves by more than a quarter of a pixel meanwhile.",
    )
    window: WindowSettings = WindowSettings.create({})
    focus: FocusEvidence = Field(
        FocusEvidence.create({}), description="What counts as evidence of a depth for focus."
    )
    paper: PaperSettings = PaperSettings.create({})

    @property
    def window_rule(self) -> Literal["time", "travel", "all"]:
        """The window rule in force."""
        if self.window.rule == "auto":
            return "travel" if self.method == "focus" else "time"
        return self.window.rule

    @property
    def window_overlap(self) -> float:
        """The overlap in force."""
        if self.window.overlap < 0:
            return TRAVEL_OVERLAP if self.window_rule == "travel" else 0.0
        return self.window.overlap

    def travel_and_step_m(self, textured: bool) -> tuple[float, float]:
        """Length of a window by travel, and the way from its start to that of the next, m."""
        length, overlap = self.window.travel_m, self.window_overlap
        if textured:
            length *= TEXTURED_SHARE
            overlap = overlap if self.window.overlap >= 0 else TEXTURED_OVERLAP
        return length, length * (1 - overlap)

    @property
    def drift_text(self) -> str:
        """Whether the drift of edges is taken out, where it is known: the paper's methods don't."""
        if self.method != "focus" and self.edge_drift.calibrated:
            return NOT_CORRECTED
        return str(self.edge_drift)

    def views(self) -> tuple[tuple[float, float], ...]:
        """(fraction of the window, weight) of the reference views that the method fuses."""
        if self.method == "left_right":
            return ((0.0, 0.5), (1.0, 0.5))
        if self.method == "bma":
            return tuple(zip(self.paper.reference_views, self.paper.weights, strict=True))
        return ((0.5, 1.0),)


class StitcherSettings(NominalSurface):
    """From depth maps to one cloud in `base`."""

    voxel_m: float = Field(
        5e-5,
        gt=0.0,
        le=1.0,
        description="Edge across the view of the voxels in which points are merged, m.",
    )
    icp: bool = Field(True, description="Refine each depth map's pose against the cloud by ICP.")
    outlier_radius_m: float = Field(
        0.0,
        ge=0.0,
        le=10.0,
        description="Points of a depth map with fewer than three neighbours within this are left "
        "out; 0 is off, m.",
    )
