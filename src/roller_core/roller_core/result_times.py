"""How long results take, and how late they are, as a status says it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

#: Results whose milliseconds count.
_NEWEST = 1000
#: Stamps this far from now, s, are of a recording: how late its results are means nothing.
_RECORDED_S = 60.0


class ResultTimes:
    """Times of the newest results."""

    def __init__(self) -> None:
        self._milliseconds: deque[float] = deque(maxlen=_NEWEST)
        self._late_s: float | None = None

    def came(self, t_ns: int, now_ns: int, milliseconds: float | None = None) -> None:
        """Note a result of a time, and how long it took where that is known."""
        if milliseconds is not None:
            self._milliseconds.append(milliseconds)
        late_s = (now_ns - t_ns) * 1e-9
        self._late_s = late_s if abs(late_s) < _RECORDED_S else None

    @property
    def latency_s(self) -> float | str:
        """How late the newest result was; empty where that isn't known."""
        return "" if self._late_s is None else round(self._late_s, 4)

    def figures(self, piece: str) -> dict[str, object]:
        """See `figures_of`."""
        return figures_of(piece, self._milliseconds)


def figures_of(piece: str, milliseconds: Iterable[float]) -> dict[str, object]:
    """Median and 95th percentile of the times that pieces took."""
    spent = list(milliseconds)
    median, p95 = np.percentile(spent, [50, 95]).round(2).tolist() if spent else (0.0, 0.0)
    return {f"{piece}_ms_median": median, f"{piece}_ms_p95": p95}
