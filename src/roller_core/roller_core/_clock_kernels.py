"""Device times to ROS time, many at a time."""

from __future__ import annotations

import numpy as np
from numba import njit

#: Times that are looked at together: sensors give the same one to hundreds of events.
_BLOCK = 64


@njit(cache=True, nogil=True)
def map_times(device_ns, base, anchor_ns, offset_ns, skew, out):  # type: ignore[no-untyped-def]
    """Device times to ROS time; blocks of one time are worked out once. `out` may be the input."""
    for start in range(0, len(device_ns), _BLOCK):
        begin = np.uint64(start)
        count = np.uint64(min(_BLOCK, len(device_ns) - start))
        first = device_ns[begin]
        differ = np.int64(0)
        for i in range(count):
            differ |= device_ns[begin + i] ^ first
        if differ == 0:
            mapped = _mapped(first, base, anchor_ns, offset_ns, skew)
            for i in range(count):
                out[begin + i] = mapped
        else:
            for i in range(count):
                out[begin + i] = _mapped(device_ns[begin + i], base, anchor_ns, offset_ns, skew)


@njit(cache=True, nogil=True)
def _mapped(d, base, anchor_ns, offset_ns, skew):  # type: ignore[no-untyped-def]
    return d + base + np.int64(np.rint((d - anchor_ns) * skew + offset_ns))
