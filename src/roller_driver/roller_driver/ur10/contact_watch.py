"""Whether the roller is on the part, from the force that the robot measures."""

from __future__ import annotations

import math
from collections.abc import Sequence

#: Slower the roller isn't rolling, m/s.
_ROLLING_M_S = 1e-3


class ContactWatch:
    """Compares the force while the tool moves with the range that is wanted.

    Parameters
    ----------
    least_n, most_n : float
        Range of the force, N; 0: no limit.

    Attributes
    ----------
    force_n : float, optional
        The newest force, N; None before the first.
    """

    def __init__(self, least_n: float, most_n: float) -> None:
        self._least_n, self._most_n = least_n, most_n
        self.force_n: float | None = None
        self._touched = self._moving = False
        self._lost = False
        self._highest_n = 0.0

    def take(self, wrench: Sequence[float], speed: Sequence[float]) -> None:
        """Take force (N, first three) and velocity (m/s, first three) of a moment."""
        self.force_n = math.hypot(*wrench[:3])
        self._highest_n = max(self._highest_n, self.force_n)
        self._moving = math.hypot(*speed[:3]) > _ROLLING_M_S
        if self.force_n >= self._least_n:
            self._touched = True
        elif self._touched and self._moving:
            self._lost, self._touched = True, False

    def verdict(self) -> str:
        """What was wrong since the last call; empty: nothing."""
        lost, highest_n = self._lost, self._highest_n
        self._lost, self._highest_n = False, self.force_n or 0.0
        if self._most_n and highest_n > self._most_n:
            return f"pressed too hard: {highest_n:.1f} N, the limit is {self._most_n:g} N"
        if self._least_n and lost:
            return f"contact lost while rolling: less than {self._least_n:g} N"
        return ""
