"""Where the camera was during a pass."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64
from roller_emvs.rays import F32

#: Rounds in which the height of the camera is found with the place from which it saw a ray: the
#: first may be off by what its height changes in view, the second by a tenth of that or so.
_ROUNDS = 3


class CameraPath:
    """Places of the camera's centre by time, forgotten as they are no longer needed.

    Parameters
    ----------
    start_ns : int
        When the pass begins, at the origin; ROS time.
    """

    def __init__(self, start_ns: int) -> None:
        self._times = [start_ns]
        self._centres: list[F64] = [np.zeros(3)]

    def add(self, t_ns: int, centre: F64) -> None:
        """The centre, metres in the strip, of a time after those before."""
        self._times.append(t_ns)
        self._centres.append(centre)

    def forget_before(self, t_ns: int) -> None:
        """Only what comes from this time on is still asked for."""
        needed = int(np.searchsorted(self._times, t_ns)) - 1
        if needed > 0:
            del self._times[:needed], self._centres[:needed]

    def centres(self, first_ns: int, last_ns: int) -> F64:
        """Centres that two times lie between, shape (n, 3)."""
        return np.array(self._centres[self._span(first_ns, last_ns)])

    def speed_m_s(self, first_ns: int, last_ns: int, least_m_s: float) -> float:
        """Mean speed along x between two times, but for where it was less than `least_m_s`."""
        seen = self._span(first_ns, last_ns)
        times, places = np.array(self._times[seen]), np.array(self._centres[seen])
        way, took_ns = np.diff(places[:, 0]), np.diff(times)
        moves = way >= least_m_s * took_ns * 1e-9
        return float(way[moves].sum() / max(took_ns[moves].sum(), 1) * 1e9)

    def across_at(self, x_m: F64, slope: F32, plane_m: float) -> tuple[F64, F64]:
        """The centre's y and z while it saw places of a plane under slopes dx/dz.

        A pass goes one way, so that the place tells the time: events needn't keep it. Linear
        between poses; all arrays are of shape (n,).
        """
        x, y, z = np.array(self._centres).T
        along = np.maximum.accumulate(x)
        height: F64 = np.full(len(x_m), z.mean())
        for _ in range(_ROUNDS):
            at = x_m - slope * (plane_m - height)
            height = np.interp(at, along, z)
        return np.interp(at, along, y), height

    def _span(self, first_ns: int, last_ns: int) -> slice:
        first = np.searchsorted(self._times, first_ns, side="right") - 1
        last = np.searchsorted(self._times, last_ns)
        return slice(max(int(first), 0), int(last) + 1)
