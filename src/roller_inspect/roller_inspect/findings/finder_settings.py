"""Settings of the search for findings."""

from __future__ import annotations

from pydantic import Field

from roller_core.settings import Settings

from .uncertainty import CellUncertainty


class Limits(Settings):
    """Limits of discrimination: what is smaller in any respect is no finding."""

    length_m: float = Field(3e-4, ge=0.0, le=0.1, description="Least length, m.")
    width_m: float = Field(2e-4, ge=0.0, le=0.1, description="Least width, m.")
    depth_m: float = Field(3e-5, ge=0.0, le=0.01, description="Least depth or height, m.")
    area_m2: float = Field(3e-7, ge=0.0, le=0.01, description="Least area, m².")
    points: int = Field(8, ge=1, le=10**9, description="Least measured points in it.")


class FindingSettings(Settings):
    """What counts as a finding."""

    limits: Limits = Limits.create({})
    cell: CellUncertainty = CellUncertainty.create({})
    edge_exclusion_m: float = Field(
        1e-3, ge=0.0, le=0.1, description="Margin of the scanned area that isn't searched, m."
    )
    weak_z: float = Field(
        2.5, ge=0.5, le=100.0, description="Deviation that may belong to a finding, in its σ."
    )
    strong_z: float = Field(
        5.0, ge=1.0, le=1000.0, description="Deviation that makes a finding, in its σ."
    )
