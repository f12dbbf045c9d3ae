"""A straight pass at one speed, with its ramps before and behind the part."""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from roller_core.settings import Settings
from roller_core.transforms import F64

#: No UR10 reaches further: 1.3 m to its flange, and a tool.
REACH_M = 2.5
#: No pendant shows a longer rotation vector, rad.
_WHOLE_TURN_RAD = 6.2832


class RollingPass(Settings):
    """Where, how fast and how hard to roll; positions of the tool centre point in base."""

    start_m: tuple[float, float, float] = Field(
        description="Where the speed must be reached: before the part, m."
    )
    end_m: tuple[float, float, float] = Field(
        description="Up to where it must be held: behind the part, m."
    )
    rotation_rad: tuple[float, float, float] = Field(
        (3.14159265, 0.0, 0.0), description="Rotation vector of the tool, as the pendant shows it."
    )
    speed_m_s: float = Field(0.1, ge=0.005, le=0.5, description="Speed of the pass, m/s.")
    acceleration_m_s2: float = Field(1.0, ge=0.05, le=3.0, description="Most in the ramps, m/s².")
    force_n: float = Field(
        0.0, ge=0.0, le=80.0, description="Press with this force; 0: hold the height, N."
    )
    lift_m: float = Field(0.05, ge=0.01, le=0.5, description="Height of approach and retreat, m.")

    @model_validator(mode="after")
    def _check(self) -> RollingPass:
        if not np.isfinite([*self.start_m, *self.end_m, *self.rotation_rad]).all():
            raise ValueError("start_m, end_m and rotation_rad must be finite")
        if self.length_m < 0.005:
            raise ValueError(
                f"start_m and end_m are {self.length_m * 1e3:.1f} mm apart: at least 5"
            )
        if (turn_rad := float(np.linalg.norm(self.rotation_rad))) > _WHOLE_TURN_RAD:
            raise ValueError(
                f"rotation_rad is {turn_rad:.3g} rad long, more than a turn: is it in degrees?"
            )
        if (away_m := max(np.linalg.norm(p) for p in (self.start_m, self.end_m))) > REACH_M:
            raise ValueError(
                f"{away_m:.3g} m from the robot's base: it reaches {REACH_M} m at most"
            )
        return self

    @property
    def length_m(self) -> float:
        """Length of the part of the pass at one speed."""
        return float(np.linalg.norm(np.subtract(self.end_m, self.start_m)))

    @property
    def ramp_s(self) -> float:
        """Time of a ramp: acceleration rises and falls as a raised cosine, without a jerk."""
        return 2.0 * self.speed_m_s / self.acceleration_m_s2

    @property
    def ramp_m(self) -> float:
        """Length of a ramp."""
        return 0.5 * self.speed_m_s * self.ramp_s

    @property
    def duration_s(self) -> float:
        """Of the pass with both ramps."""
        return 2.0 * self.ramp_s + self.length_m / self.speed_m_s

    @property
    def ends_m(self) -> tuple[F64, F64]:
        """Where the tool stands before and after the pass, shape (3,) each."""
        start, end = np.array(self.start_m), np.array(self.end_m)
        ramp = (end - start) / self.length_m * self.ramp_m
        return start - ramp, end + ramp

    def positions_m(self, t_s: F64) -> F64:
        """Positions of the tool at times from 0 to `duration_s`, shape (n, 3)."""
        begin, end = self.ends_m
        along = self._ramp(np.minimum(t_s, self.ramp_s))
        along += self.speed_m_s * np.clip(t_s - self.ramp_s, 0, self.length_m / self.speed_m_s)
        left = np.clip(self.duration_s - t_s, 0, self.ramp_s)
        along += np.where(t_s > self.duration_s - self.ramp_s, self.ramp_m - self._ramp(left), 0.0)
        direction = (end - begin) / np.linalg.norm(end - begin)
        return np.asarray(begin + along[:, None] * direction)

    def _ramp(self, t_s: F64) -> F64:
        """Path from rest in a ramp, metres."""
        turn = 2 * np.pi / self.ramp_s
        path = 0.5 * t_s**2 + (np.cos(turn * t_s) - 1.0) / turn**2
        return np.asarray(self.speed_m_s / self.ramp_s * path)
