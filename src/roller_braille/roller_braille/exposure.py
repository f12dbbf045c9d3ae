"""How long places on the surface were in view, as the sensor rolls."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .warp import F32, F64, Knots

#: Columns seen over less than this share of the full travel are not made up for.
_LEAST_EXPOSURE = 0.25
#: Batches' ends by which the pace is measured.
_NEWEST = 5


class Exposure:
    """Travel of the sensor, the time it took, and what was in view meanwhile.

    Parameters
    ----------
    px_m : float
        Pixel of the mosaic, metres; column c is at c times that.
    half_m : float
        Half width of the view, metres.
    read_at_m : float
        How far behind the sensor places are read, metres.
    """

    def __init__(self, px_m: float, half_m: float, read_at_m: float) -> None:
        self._px_m, self._half, self._read_at = px_m, half_m, min(read_at_m, half_m)
        self._begin: float | None = None
        self._end = 0.0
        # How long the sensor had rolled when it had come so far.
        self._travel: list[float] = []
        self._clock: list[float] = []

    def add(self, knots: Knots) -> None:
        """Take the travel of a batch."""
        if self._begin is None:
            self._begin = self._end = float(knots.along[0])
        self._end = max(self._end, float(knots.along[-1]))
        rolled = self.rolled_s
        seconds = rolled + (knots.times_ns[[0, -1]] - knots.times_ns[0]) * 1e-9
        travel = np.maximum(knots.along[[0, -1]], self._travel[-1] if self._travel else -np.inf)
        first = 1 if self._travel else 0
        self._travel += travel[first:].tolist()
        self._clock += seconds[first:].tolist()

    def forget_before(self, along_m: float) -> None:
        """Places before this one won't be asked for any more."""
        gone = int(np.searchsorted(self._travel, along_m - self._half)) - 1
        if gone > 0:
            del self._travel[:gone], self._clock[:gone]

    @property
    def complete(self) -> int:
        """Columns before this one were seen for long enough to be read."""
        return int((self._end - self._read_at) // self._px_m) if self._begin is not None else 0

    @property
    def rolled_s(self) -> float:
        """Time for which the sensor has rolled, seconds."""
        return self._clock[-1] if self._clock else 0.0

    @property
    def pace_s_m(self) -> float:
        """Seconds that a metre took over the newest batches; 0 before the first."""
        travel, clock = self._travel[-_NEWEST:], self._clock[-_NEWEST:]
        return (clock[-1] - clock[0]) / max(travel[-1] - travel[0], 1e-9) if travel else 0.0

    @property
    def half_seen(self) -> int:
        """Columns before this one were seen over half of the full travel."""
        return int(self._end // self._px_m)

    @property
    def glimpsed(self) -> int:
        """Columns before this one were seen for long enough to be made up for."""
        return int((self._end + self._half * (1 - 2 * _LEAST_EXPOSURE)) // self._px_m)

    @property
    def seen(self) -> tuple[int, int]:
        """First column seen and the one after the last."""
        if self._begin is None:
            return 0, 0
        a = int(np.ceil((self._begin - self._half) / self._px_m))
        return a, int(np.floor((self._end + self._half) / self._px_m)) + 1

    def seconds(self, a: int, b: int) -> float:
        """Mean time that columns a to b were in view, made up to the full travel, seconds."""
        place = np.linspace(a, b, 5, dtype=np.float64) * self._px_m
        travel, clock = np.array(self._travel), np.array(self._clock)
        seen = np.interp(place + self._half, travel, clock) - np.interp(
            place - self._half, travel, clock
        )
        share = np.maximum(self._share_at(place), _LEAST_EXPOSURE)
        return float((seen / share).mean())

    def shown(self, place_m: F64) -> npt.NDArray[np.bool_]:
        """Whether places along the roll, shape (n,), were in view long enough to know of dots."""
        return np.asarray(self._share_at(place_m) >= _LEAST_EXPOSURE)

    def share(self, a: int, b: int) -> F64:
        """Share of the full travel over which columns were seen, 0 to 1, shape (b - a,)."""
        return self._share_at(np.arange(a, b, dtype=np.float64) * self._px_m)

    def _share_at(self, place: F64) -> F64:
        if self._begin is None:
            return np.zeros(len(place))
        last = np.minimum(self._end, place + self._half)
        seen = last - np.maximum(self._begin, place - self._half)
        return np.asarray(np.clip(seen / (2 * self._half), 0.0, 1.0))

    def gain(self, a: int, b: int) -> F32:
        """What counts of columns a to b (b excluded) are multiplied by, shape (b - a,)."""
        share = self.share(a, b)
        gain = np.where(share >= _LEAST_EXPOSURE, 1 / np.maximum(share, 1e-3), 1.0)
        return gain.astype(np.float32)
