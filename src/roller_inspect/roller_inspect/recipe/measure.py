"""A named figure of a part, as recipes ask for it."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from roller_core.settings import Settings
from roller_core.transforms import F64

Tool = Literal[
    "step_height",
    "flushness",
    "tilt",
    "width",
    "depth",
    "diameter",
    "area",
    "volume",
    "roughness_sa",
    "roughness_sq",
]
#: Tools that can measure along a line, and those that need no datum.
ALONG, ALONE = ("width", "depth"), ("width", "roughness_sa", "roughness_sq")
#: The skin follows no step that is higher, m.
DEEPEST_M = 0.01


class Measure(Settings):
    """A named figure of the part; without limits it is reported alone."""

    name: str = Field(min_length=1, description="What reports call it.")
    tool: Tool = Field(description="How it is measured.")
    of: str = Field(description="The region that it is of; of width, and of depth, a line.")
    datum: str = Field("", description="The region whose plane it is measured from.")
    low: float | None = Field(None, description="Least value: m, m², m³ or rad, by the tool.")
    high: float | None = Field(None, description="Most value.")

    @model_validator(mode="after")
    def _check(self) -> Measure:
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError("low is above high")
        if self.of == self.datum:
            raise ValueError("a region is no datum of its own")
        return self

    def check_limits(self, where: str, outline: F64) -> None:
        """Refuse limits beyond what the region or line of this outline, (n, 2), can have."""
        width, height = np.ptp(outline, axis=0).tolist()
        most, unit = {
            "tilt": (math.pi / 2, "rad"),
            "width": (math.hypot(width, height), "m"),
            "diameter": (math.hypot(width, height), "m"),
            "area": (width * height, "m²"),
            "volume": (width * height * DEEPEST_M, "m³"),
        }.get(self.tool, (DEEPEST_M, "m"))
        for name, value in (("low", self.low), ("high", self.high)):
            if value is not None and abs(value) > most:
                raise ValueError(
                    f"'{where}.{name}' = {value:g}: {self.tool} of '{self.of}' is at most "
                    f"{most:.3g} {unit}; limits are in m, m², m³ and rad"
                )
