"""Settings of the search for findings."""

from __future__ import annotations

from pydantic import Field

from roller_core.settings import Settings

from .limits import Limits
from .uncertainty import CellUncertainty


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
