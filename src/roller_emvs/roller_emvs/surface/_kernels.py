"""Loop over events; it has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _place(x, y, t, rays, t0, t1, p0, p1, r0, r1, z, out):  # type: ignore[no-untyped-def]
    """Where rays meet the plane z, and their slopes; NaN for rays that don't.

    `rays` holds the direction (x, y at unit depth) of every pixel. Between the poses at t0 and t1
    position and rotation go linearly: a pose interval turns by far less than it takes to notice.
    """
    for i in range(len(x)):
        f = np.float64(t[i] - t0) / np.float64(t1 - t0)
        a = np.float64(rays[y[i], x[i], 0])
        b = np.float64(rays[y[i], x[i], 1])
        d0 = (r0[0, 0] * a + r0[0, 1] * b + r0[0, 2]) * (1 - f)
        d1 = (r0[1, 0] * a + r0[1, 1] * b + r0[1, 2]) * (1 - f)
        d2 = (r0[2, 0] * a + r0[2, 1] * b + r0[2, 2]) * (1 - f)
        d0 += (r1[0, 0] * a + r1[0, 1] * b + r1[0, 2]) * f
        d1 += (r1[1, 0] * a + r1[1, 1] * b + r1[1, 2]) * f
        d2 += (r1[2, 0] * a + r1[2, 1] * b + r1[2, 2]) * f
        if not d2 > 1e-6:
            out[0, i] = np.nan
            out[1, i] = np.nan
            out[2, i] = np.nan
            out[3, i] = np.nan
            continue
        sx = d0 / d2
        sy = d1 / d2
        away = z - (p0[2] + f * (p1[2] - p0[2]))
        out[0, i] = p0[0] + f * (p1[0] - p0[0]) + sx * away
        out[1, i] = p0[1] + f * (p1[1] - p0[1]) + sy * away
        out[2, i] = sx
        out[3, i] = sy
