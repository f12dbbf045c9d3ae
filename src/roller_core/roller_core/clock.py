"""From a device's clock to ROS time.

A message can arrive late but never early, so the smallest (arrival - device time) of each half
second lies on the true offset plus the least delay, which no one-way clock map can see. A robust
line under those minima gives offset and skew (the convex-hull idea of Zhang, Liu and Xia, INFOCOM
2002, in the simpler form of block minima and a Theil-Sen slope).

The map's rate counts as well as its offset: depth is speed times time, so a rate that is wrong by
100 ppm for the length of a window is 4.5 µm at 45 mm. The map therefore approaches a new line
slowly.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import numpy.typing as npt

I64 = npt.NDArray[np.int64]
_BLOCK_NS = 500_000_000
_MAX_BLOCKS = 120
_MIN_BLOCKS_FOR_SKEW = 4
#: Without a skew the offset is that of so many blocks: older ones have drifted.
_BLOCKS_WITHOUT_SKEW = 2
_MAX_SKEW = 500e-6
#: A slope over a time as short as this is believed by half.
_BELIEVED_NS = 1.5e9
#: In the first second the map follows at once; later it approaches with a time constant that is
#: this share of its age and at most two seconds, and no faster than that.
_SETTLING_NS = 1_000_000_000
_APPROACH_SHARE = 0.2
_APPROACH_NS = 2_000_000_000
_MAX_SLEW = 200e-6
#: The offset is this quantile of the blocks: the floor, but for single blocks that came early.
_FLOOR = 0.1
#: A message may be early by what a young map is wrong; by more the clock has jumped.
_EARLY_NS = 5_000_000
#: A block that is later than this was held up: it says nothing of the clock...
_LATE_NS = 5_000_000
#: ... unless all are, one after the other: then the clock has jumped.
_MAX_LATE_BLOCKS = 10
#: Nothing is held up for so long.
_STEP_NS = 5_000_000_000
#: A device's clock that goes back by more than this was set again.
_BACK_NS = 500_000_000
#: Stamps that would go back by less than this are those of messages that are no longer held up.
_HELD_UP_NS = 2_000_000_000
#: Times from which on a kernel maps them.
_MANY = 1000


class SensorClock:
    """Maps device time to ROS time from pairs of (device time, arrival).

    The map is a function of the pairs in their order alone, so a replay gives the times that the
    live graph gave. After the first second it moves by at most 200 µs a second. Messages that are
    held up for seconds leave it as it is. Where the clock has jumped, the device's or the host's,
    it restarts: at once when time went back or messages come early, after five seconds when
    all come late, which a jam can't tell from a jump before.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[int, int]] = deque(maxlen=_MAX_BLOCKS)
        self._open: tuple[int, int] = (0, 0)
        self._block = 0
        self._late_blocks = 0
        self._base = 0
        self._anchor_ns = 0
        self._offset_ns = 0.0
        self._start_ns = 0
        self._skew = 0.0
        self._residual_ns = 0.0
        self._scatter_ns = 0.0
        self._observed = False
        self._line = (0, 0.0, 0.0)
        self._given_ns: int | None = None
        #: Times that the clock has jumped.
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
    def scatter_s(self) -> float:
        """Median distance of the blocks' smallest delays from the line through them, seconds.

        What the map may be wrong by; 0 until there is a line.
        """
        return self._scatter_ns * 1e-9

    def observe(self, device_ns: int, arrival_ns: int) -> None:
        """Take note that what the device stamped `device_ns` arrived at `arrival_ns`."""
        if not self._observed:
            self._restart(device_ns, arrival_ns)
            return
        delay = arrival_ns - device_ns - self._base
        late = delay - self._offset_at(device_ns)
        settled = device_ns - self._start_ns > _SETTLING_NS
        if device_ns < self._anchor_ns - _BACK_NS:
            self._given_ns = None  # it was set again: times begin anew
            self._step(device_ns, arrival_ns)
            return
        if late > _STEP_NS or late < (-_EARLY_NS if settled else -_STEP_NS):
            self._step(device_ns, arrival_ns)
            return
        block = (device_ns - self._start_ns) // _BLOCK_NS
        if block != self._block:
            self._block = block
            if not self._close():
                self._step(device_ns, arrival_ns)
                return
            self._open = (device_ns, delay)
        elif delay < self._open[1]:
            self._open = (device_ns, delay)
            if len(self._blocks) < _MIN_BLOCKS_FOR_SKEW:
                self._fit()
        self._move(device_ns, settled)
        self._residual_ns = delay - self._offset_at(device_ns)

    def restart(self) -> None:
        """Forget the map: the device itself was started again, which is no jump of its clock."""
        self._observed, self._given_ns = False, None

    def to_ros_ns(self, device_ns: npt.ArrayLike) -> I64:
        """ROS time of device times, int64 ns, with the map as it stands."""
        d = np.asarray(device_ns, dtype=np.int64)
        line = (np.int64(self._base), np.int64(self._anchor_ns), self._offset_ns, self._skew)
        if d.size < _MANY:
            return _map(d, *line)
        # Nodes that map but a time or two a message do without numba.
        from ._clock_kernels import map_times

        out = np.empty(d.shape, np.int64)
        map_times(d.reshape(-1), *line, out.reshape(-1))
        return out

    def stamp(self, device_ns: int) -> int | None:
        """ROS time of the newest message, ns; None where one before was given a later time.

        In its first second the map follows at once, and where messages come early it begins anew:
        what had been held up before was stamped too late. Where a clock was set, the device's or
        by more than messages are held up, times begin anew.
        """
        stamp_ns = int(self.to_ros_ns(device_ns))
        given_ns = self._given_ns
        if given_ns is not None and given_ns - _HELD_UP_NS < stamp_ns <= given_ns:
            return None
        self._given_ns = stamp_ns
        return stamp_ns

    def _step(self, device_ns: int, arrival_ns: int) -> None:
        self.steps += 1
        self._restart(device_ns, arrival_ns)

    def _restart(self, device_ns: int, arrival_ns: int) -> None:
        # The first offset stays an exact integer; everything after is small against it.
        self._base = arrival_ns - device_ns
        self._blocks.clear()
        self._open = (device_ns, 0)
        self._block = self._late_blocks = 0
        self._start_ns = self._anchor_ns = device_ns
        self._offset_ns = self._skew = self._residual_ns = self._scatter_ns = 0.0
        self._line = (device_ns, 0.0, 0.0)
        self._observed = True

    def _offset_at(self, device_ns: int) -> float:
        return self._offset_ns + (device_ns - self._anchor_ns) * self._skew

    def _move(self, device_ns: int, settled: bool) -> None:
        """Let the map approach the fitted line."""
        origin, offset, skew = self._line
        now = self._offset_at(device_ns)
        step = offset + (device_ns - origin) * skew - now
        if settled:
            elapsed = max(device_ns - self._anchor_ns, 0)
            limit = elapsed * _MAX_SLEW
            age = device_ns - self._start_ns
            step *= 1.0 - math.exp(-elapsed / min(_APPROACH_SHARE * age, _APPROACH_NS))
            step = min(max(step, -limit), limit)
        self._offset_ns = now + step
        self._anchor_ns = device_ns
        self._skew = skew

    def _close(self) -> bool:
        """Take the block that is complete into the line; False when the clock has jumped."""
        device_ns, delay = self._open
        if delay - self._offset_at(device_ns) > _LATE_NS:
            self._late_blocks += 1
            return self._late_blocks < _MAX_LATE_BLOCKS
        self._late_blocks = 0
        self._blocks.append(self._open)
        self._fit()
        return True

    def _fit(self) -> None:
        """Lay the line under the blocks' minima."""
        if len(self._blocks) < _MIN_BLOCKS_FOR_SKEW:
            newest = [*self._blocks, self._open][-_BLOCKS_WITHOUT_SKEW:]
            self._line = (newest[-1][0], float(min(delay for _, delay in newest)), 0.0)
            return
        origin = self._blocks[-1][0]
        blocks = np.array(self._blocks, dtype=np.int64)
        times, delays = (blocks[:, 0] - origin).astype(np.float64), blocks[:, 1].astype(np.float64)
        i, j = np.triu_indices(len(times), 1)
        slope = float(np.median((delays[j] - delays[i]) / (times[j] - times[i])))
        slope = min(max(slope, -_MAX_SKEW), _MAX_SKEW)
        slope *= 1.0 / (1.0 + (_BELIEVED_NS / times[0]) ** 2)
        above = delays - slope * times
        self._scatter_ns = float(np.median(np.abs(above - np.median(above))))
        self._line = (origin, float(np.quantile(above, _FLOOR)), slope)


def _map(device_ns: I64, base: np.int64, anchor_ns: np.int64, offset_ns: float, skew: float) -> I64:
    """What the kernel does, in numpy."""
    moved = np.rint((device_ns - anchor_ns) * skew + offset_ns)
    return np.asarray(device_ns + base + moved.astype(np.int64), np.int64)
