"""Whether the stamps of a sensor's poses suit its path: depth is parallax over travel."""

from __future__ import annotations

import numpy as np

from .pose_track import PoseError, PoseTrack
from .transforms import F64

#: Poses that are looked at, at least, and the fewest that say something.
_USUAL, _LEAST = 24, 10
#: Spans further apart in time than this have nothing in common, ns.
_APART_NS = 100_000_000
#: Scatter of places that is let pass, m; scatter of the path itself, as a share of that by the
#: stamps, from which on the stamps are not to blame.
_MOST_M, _OWN = 1e-4, 0.5


class UnevenStampsError(PoseError):
    """Poses whose stamps scatter too much for depth."""


class StampWatch:
    """Looks at the poses of span after span, and at those of spans just before where they are few.

    What it says depends on the spans alone, not on when poses came.
    """

    def __init__(self) -> None:
        self._t = np.empty(0, np.int64)
        self._p = np.empty((0, 3))

    def check(self, track: PoseTrack, start_ns: int, end_ns: int) -> None:
        """Refuse a span in which poses lie unevenly along the path, by their stamps' fault.

        What a robot does shows alike in poses after each other, or also where they are taken to be
        equally far apart in time; jitter of stamps does neither.

        Parameters
        ----------
        track : PoseTrack
            Poses.
        start_ns, end_ns : int
            Span; spans go on in time, and may overlap.

        Raises
        ------
        UnevenStampsError
            Saying by how much.
        """
        first, last = np.searchsorted(track.times_ns, (start_ns, end_ns))
        t, p = track.times_ns[first:last], track.positions[first:last]
        count = len(t)
        if len(self._t):
            new = t > self._t[-1]
            if count and t[0] - self._t[-1] <= _APART_NS:
                t, p = np.append(self._t, t[new]), np.concatenate([self._p, p[new]])
        keep = max(_USUAL, count)
        self._t, self._p = t[-keep:].copy(), p[-keep:].copy()
        if len(self._t) < _LEAST:
            return
        seconds, p = (self._t - self._t[0]) * 1e-9, self._p
        scatter = _scatter_m(seconds, p)
        if scatter < _MOST_M or _scatter_m(np.arange(len(p), dtype=np.float64), p) > _OWN * scatter:
            return
        speed = float(np.linalg.norm(p[-1] - p[0])) / seconds[-1]
        raise UnevenStampsError(
            f"the stamps of the poses scatter by some {1e3 * scatter / 1.5 / speed:.1f} ms, "
            f"{1e3 * scatter / 1.5:.2f} mm of the way: no depth; is the robot's computer too busy?"
        )


def _scatter_m(t: F64, p: F64) -> float:
    """How far poses scatter along their path, from one to the next, metres.

    The usual change, from a pose to the next, of how far each lies off the straight line in time
    through its neighbours: 1.5 times the deviation of places that scatter by chance.
    """
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    off = p[1:-1] - (1 - share) * p[:-2] - share * p[2:]
    way = p[-1] - p[0]
    along = off @ (way / max(float(np.linalg.norm(way)), 1e-12))
    return float(np.median(np.abs(np.diff(along))))
