"""Device times to ROS time, many at a time."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def map_times(device_ns, base, anchor_ns, offset_ns, skew, out):  # type: ignore[no-untyped-def]
    for i in range(len(device_ns)):
        d = device_ns[i]
        out[i] = d + base + np.int64(np.rint((d - anchor_ns) * skew + offset_ns))
