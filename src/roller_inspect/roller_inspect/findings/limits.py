"""What is too small to be a finding."""

from __future__ import annotations

from pydantic import Field

from roller_core.settings import Settings


class Limits(Settings):
    """Limits of discrimination: what is smaller in any respect is no finding."""

    length_m: float = Field(3e-4, ge=0.0, le=0.1, description="Least length, m.")
    width_m: float = Field(2e-4, ge=0.0, le=0.1, description="Least width, m.")
    depth_m: float = Field(3e-5, ge=0.0, le=0.01, description="Least depth or height, m.")
    area_m2: float = Field(3e-7, ge=0.0, le=0.01, description="Least area, m².")
    points: int = Field(8, ge=1, le=10**9, description="Least measured points in it.")
