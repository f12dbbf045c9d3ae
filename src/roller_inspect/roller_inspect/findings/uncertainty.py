"""What the uncertainty of a finding's figures is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pydantic import Field

from roller_core.settings import Settings

#: What the skin rounds of an outline's edge, m, and the share of a depth that it, and the patches
#: that depth is told from, don't follow, by as much more as it is narrower than this, m: biases
#: that nothing corrects, as standard uncertainties. Tuned on the virtual cell.
_ROUNDS_M, _NOT_FOLLOWED, _NARROW_M = 2.5e-4, 0.1, 1.5e-3
#: What is taken for granted where nothing is known: the drift of edges under the virtual cell's
#: ring, a camera calibrated to half a percent, a robot that repeats within 0.1 mm (rectangular).
_DRIFT_M, _SCALE, _POSE_M = 1.2e-4, 5e-3, 5.8e-5


class CellUncertainty(Settings):
    """What the cell adds to the uncertainty of figures, k = 1."""

    drift_m: float = Field(
        0.0,
        ge=0.0,
        le=1e-2,
        description="Height by which edges are off on a slope of 1 after the correction of their "
        "drift, m; `roller calibrate edge-drift` writes it; 0: not calibrated.",
    )
    scale: float = Field(
        0.0,
        ge=0.0,
        le=0.1,
        description="Of lengths and depths, as a share of them: camera and robot; 0: not known.",
    )
    pose_m: float = Field(
        0.0,
        ge=0.0,
        le=1e-2,
        description="Of the camera's place in base: the robot's repeatability, hand-eye, m; "
        "0: not known.",
    )

    @property
    def values(self) -> tuple[float, float, float]:
        """Drift, scale and pose, what is usual where nothing is known."""
        return self.drift_m or _DRIFT_M, self.scale or _SCALE, self.pose_m or _POSE_M

    def sources(self) -> dict[str, str]:
        """Where each contribution comes from, in words."""
        drift, scale, pose = self.values
        taken = "{}, taken for granted"
        return {
            "scatter": "this scan's own scatter, at the finest and the coarsest scale, or what the "
            "points there say of themselves where that is more",
            "reference": "of the reference that heights are held against",
            "skin": f"what skin and depth don't follow: {_NOT_FOLLOWED:.0%} of a depth, more where "
            f"it is narrower than {_NARROW_M * 1e3:g} mm",
            "drift": f"drift of edges left over, {drift * 1e6:.0f} µm on a slope of 1: "
            + ("calibrated" if self.drift_m else taken.format("not calibrated")),
            "scale": f"{scale:.1%} of lengths and depths: "
            + ("given for this cell" if self.scale else taken.format("not known")),
            "pose": f"{pose * 1e6:.0f} µm of places, and of heights that rest on the robot alone: "
            + ("given for this cell" if self.pose_m else taken.format("not known")),
        }


@dataclass(frozen=True)
class Budget:
    """Contributions to the uncertainty of a depth, k = 1, metres; see `CellUncertainty.sources`."""

    scatter: float
    reference: float
    skin: float
    drift: float
    scale: float
    pose: float

    @property
    def total(self) -> float:
        """All of them."""
        return math.hypot(*vars(self).values())


@dataclass(frozen=True)
class Uncertainty:
    """Expanded uncertainties (k = 2) of a finding's figures, in the units of the figures."""

    center_m: float
    length_m: float
    width_m: float
    depth_m: float
    area_m2: float
    volume_m3: float


def uncertainty(
    scatter_m: tuple[float, float],
    reference_m: float,
    by_pose: bool,
    sizes_m: tuple[float, float, float],
    area_m2: float,
    hollow_m: float,
    step_m: float,
    cell: CellUncertainty,
) -> tuple[Uncertainty, Budget]:
    """Of a finding's figures.

    Parameters
    ----------
    scatter_m : (float, float)
        Of heights in it, and of heights smoothed by the coarsest scale: neighbours share errors.
    reference_m : float
        Standard uncertainty of the reference.
    by_pose : bool
        Whether heights rest on the robot's pose alone.
    sizes_m : (float, float, float)
        Length, width and depth.
    area_m2 : float
        Its area.
    hollow_m : float
        Width of what the skin has to follow: of a crater without its edge.
    step_m : float
        Edge of a cell.
    cell : CellUncertainty
        What calibrations and settings say.
    """
    length, width, depth = sizes_m
    drift, scale, pose = cell.values
    # The deepest place of a round hollow is level: drift shifts its flanks, of half their slope.
    slope = depth / hollow_m
    budget = Budget(
        math.hypot(*scatter_m),
        reference_m,
        _NOT_FOLLOWED * depth * (1 + (_NARROW_M / hollow_m) ** 2),
        drift * slope,
        scale * depth,
        pose if by_pose else 0.0,
    )
    height = math.hypot(budget.scatter, budget.reference)
    # The outline moves where the flank's slope meets the noise; a flank takes half the width. The
    # skin rounds both edges alike.
    edge = math.hypot(step_m / math.sqrt(12), 0.5 * width * min(height / depth, 1.0))
    side = math.hypot(math.sqrt(2) * edge, 2 * _ROUNDS_M)
    u_area = math.hypot((length + width) * side, 2 * scale * area_m2)
    common = math.hypot(scatter_m[1], reference_m, budget.skin, budget.drift, budget.scale)
    return Uncertainty(
        center_m=2 * math.hypot(edge, pose),
        length_m=2 * math.hypot(side, scale * length),
        width_m=2 * math.hypot(side, scale * width),
        depth_m=2 * budget.total,
        area_m2=2 * u_area,
        volume_m3=2 * math.hypot(area_m2 * common, u_area * depth / 2),
    ), budget
