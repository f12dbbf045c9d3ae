"""From a device's clock to ROS time.

A message can arrive late but never early, so the smallest (arrival - device time) of each second
lies on the true offset plus the constant part of the delay. A robust line through those minima
gives offset and skew (the convex-hull idea of Zhang, Liu and Xia, INFOCOM 2002, in the simpler
form of block minima and a Theil-Sen slope).
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

_BLOCK_NS = 1_000_000_000
_MAX_BLOCKS = 60
_MIN_BLOCKS_FOR_SKEW = 5
_MAX_SKEW = 500e-6
_MAX_SLEW = 200e-6
_STEP_NS = 500_000_000


class SensorClock:
    """Maps device time to ROS time from pairs of (device time, arrival).

    The map is a function of the pairs in their order alone, so a replay gives the times that the
    live graph gave. It is continuous: after the first second it moves by at most 200 µs a second,
    except where the device's clock jumps by more than half a second, where it starts anew.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[int, int]] = deque(maxlen=_MAX_BLOCKS)
        self._block = -1
        self._base = 0
        self._anchor_ns = 0
        self._offset_ns = 0.0
        self._start_ns = 0
        self._skew = 0.0
        self._residual_ns = 0.0
        self._observed = False
        self._line = (0, 0.0, 0.0)
        self.steps = 0

    @property
    def skew(self) -> float:
        """Rate of ROS time against device time, less one."""
        return self._skew

    @property
    def residual_s(self) -> float:
        """How late the newest message came against the map, seconds."""
        return self._residual_ns * 1e-9

    @property
    def offset_s(self) -> float:
        """ROS time minus device time at the newest message, seconds."""
        return (self._base + self._offset_ns) * 1e-9

    def observe(self, device_ns: int, arrival_ns: int) -> None:
        """Take note that what the device stamped `device_ns` arrived at `arrival_ns`."""
        if not self._observed:
            self._restart(device_ns, arrival_ns)
            return
        delay = arrival_ns - device_ns - self._base
        if (
            abs(delay - self._offset_at(device_ns)) > _STEP_NS
            or device_ns < self._anchor_ns - _STEP_NS
        ):
            self.steps += 1
            self._restart(device_ns, arrival_ns)
            return
        block = (device_ns - self._start_ns) // _BLOCK_NS
        if block != self._block:
            self._block = block
            self._blocks.append((device_ns, delay))
            self._fit()
        elif delay < self._blocks[-1][1]:
            self._blocks[-1] = (device_ns, delay)
            self._fit()
        self._move(device_ns)
        self._residual_ns = delay - self._offset_at(device_ns)

    def to_ros_ns(self, device_ns: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """ROS time of device times, int64 ns, with the map as it stands."""
        d = np.asarray(device_ns, dtype=np.int64)
        drift = (d - self._anchor_ns) * self._skew + self._offset_ns
        return d + self._base + np.rint(drift).astype(np.int64)

    def _restart(self, device_ns: int, arrival_ns: int) -> None:
        # The first offset stays an exact integer; everything after is small against it.
        self._base = arrival_ns - device_ns
        self._blocks.clear()
        self._blocks.append((device_ns, 0))
        self._block = 0
        self._start_ns = self._anchor_ns = device_ns
        self._offset_ns = self._skew = self._residual_ns = 0.0
        self._line = (device_ns, 0.0, 0.0)
        self._observed = True

    def _offset_at(self, device_ns: int) -> float:
        return self._offset_ns + (device_ns - self._anchor_ns) * self._skew

    def _move(self, device_ns: int) -> None:
        """Let the map approach the fitted line."""
        origin, offset, skew = self._line
        now = self._offset_at(device_ns)
        step = offset + (device_ns - origin) * skew - now
        if device_ns - self._start_ns > _BLOCK_NS:
            limit = max(device_ns - self._anchor_ns, 0) * _MAX_SLEW
            step = min(max(step, -limit), limit)
        self._offset_ns = now + step
        self._anchor_ns = device_ns
        self._skew = skew

    def _fit(self) -> None:
        """Lay the line under the block minima."""
        origin = self._blocks[-1][0]
        times = np.array([b[0] - origin for b in self._blocks], dtype=np.float64)
        delays = np.array([b[1] for b in self._blocks], dtype=np.float64)
        slope = 0.0
        offset = float(delays[-_MIN_BLOCKS_FOR_SKEW:].min())
        if len(times) >= _MIN_BLOCKS_FOR_SKEW:
            i, j = np.triu_indices(len(times), 1)
            slope = float(np.median((delays[j] - delays[i]) / (times[j] - times[i])))
            slope = min(max(slope, -_MAX_SKEW), _MAX_SKEW)
            offset = float(np.median(delays - slope * times))
        self._line = (origin, offset, slope)
