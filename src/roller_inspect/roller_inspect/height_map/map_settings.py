"""Settings of the height map."""

from __future__ import annotations

from pydantic import Field

from roller_core.settings import Settings


class HeightMapSettings(Settings):
    """The grid, and how far it goes on from what was measured."""

    grid_m: float = Field(1e-4, ge=1e-5, le=0.01, description="Edge of a cell, m.")
    reach_m: float = Field(
        3e-4,
        ge=0.0,
        le=0.1,
        description="A cell within this of a measured one goes on from it; others are unmeasured, "
        "m.",
    )
    max_cells: int = Field(
        2_500_000,
        ge=10_000,
        le=1_000_000_000,
        description="Cells kept at once; a longer scan is given in pieces, and as a coarser whole.",
    )
