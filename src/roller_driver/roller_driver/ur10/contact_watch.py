"""Whether the roller is on the part, from the force that the robot measures."""

from __future__ import annotations

import math
from collections.abc import Sequence

#: Slower the roller isn't rolling, m/s; nor where less of its motion goes the way it rolled.
_ROLLING_M_S, _ALONG = 1e-3, 0.5


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
        self._touched = self._lost = False
        #: Velocity with which it last rolled in contact, m/s.
        self._rolled: Sequence[float] = (0.0, 0.0, 0.0)
        self._highest_n = 0.0

    def take(self, wrench: Sequence[float], speed: Sequence[float]) -> None:
        """Take force (N, first three) and velocity (m/s, first three) of a moment."""
        self.force_n = math.hypot(*wrench[:3])
        self._highest_n = max(self._highest_n, self.force_n)
        moves_m_s = math.hypot(*speed[:3])
        if self.force_n >= self._least_n:
            self._touched = True
            if moves_m_s > _ROLLING_M_S:
                self._rolled = tuple(speed[:3])
        elif self._touched:
            way = sum(a * b for a, b in zip(speed, self._rolled, strict=False))
            along_m_s = abs(way) / max(math.hypot(*self._rolled), _ROLLING_M_S)
            if along_m_s > max(_ROLLING_M_S, _ALONG * moves_m_s):
                self._lost = True
            else:
                self._touched = False  # it was lifted

    def verdict(self) -> str:
        """What was wrong since the last call; empty: nothing."""
        lost, highest_n = self._lost, self._highest_n
        self._lost, self._highest_n = False, self.force_n or 0.0
        if self._most_n and highest_n > self._most_n:
            return f"pressed too hard: {highest_n:.1f} N, the limit is {self._most_n:g} N"
        if self._least_n and lost:
            return f"contact lost while rolling: less than {self._least_n:g} N"
        return ""
