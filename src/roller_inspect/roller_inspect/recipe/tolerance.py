"""What a finding may be at most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field, model_validator

from roller_core.settings import Settings
from roller_inspect.findings import KINDS, Limits

from .measure import DEEPEST_M

#: Sizes that a tolerance may limit, as a finding has them.
_SIZES = ("depth_m", "length_m", "width_m", "area_m2", "volume_m3")


class Tolerance(Settings):
    """What a finding may be at most; of those in the list the first that fits it holds."""

    region: str = Field("", description="In which region; empty: anywhere.")
    kind: Literal["any", "dent", "crater", "scratch", "raised", "missing", "extra"] = Field(
        "any", description="Of which kind."
    )
    # Far beyond these a number is in another unit, and would let everything pass.
    depth_m: float | None = Field(None, ge=0, le=DEEPEST_M, description="Most depth or height, m.")
    length_m: float | None = Field(None, ge=0, le=0.1, description="Most length, m.")
    width_m: float | None = Field(None, ge=0, le=0.1, description="Most width, m.")
    area_m2: float | None = Field(None, ge=0, le=0.01, description="Most area, m².")
    volume_m3: float | None = Field(None, ge=0, le=1e-4, description="Most volume, m³.")

    @model_validator(mode="after")
    def _check(self) -> Tolerance:
        if not self.limits():
            raise ValueError(f"a tolerance limits one of {', '.join(_SIZES)}")
        return self

    def limits(self) -> dict[str, float]:
        """What it limits."""
        return {name: v for name in _SIZES if (v := getattr(self, name)) is not None}


#: What a finding may be where no tolerance of the recipe fits it.
DEFAULT_TOLERANCE = Tolerance.create({"depth_m": 100e-6})


def check_discrimination(tolerances: Sequence[Tolerance], limits: Limits) -> None:
    """Refuse limits under which a tolerance would never be seen to be exceeded.

    Raises
    ------
    ValueError
        Naming it.
    """
    usual, left = Limits.create({}), set(KINDS)
    for tolerance in (*tolerances, DEFAULT_TOLERANCE):
        which = "the default tolerance" if tolerance is DEFAULT_TOLERANCE else "a tolerance"
        for name, most in tolerance.limits().items():
            least = getattr(limits, name, 0.0)
            if least > most and least != getattr(usual, name):
                raise ValueError(
                    f"'limits.{name}' is {least:g}, above {which} of {most:g}: what lies between "
                    "is never found, and would pass"
                )
        if not tolerance.region:
            left -= set(KINDS) if tolerance.kind == "any" else {tolerance.kind}
        if not left:
            return  # none after it holds
