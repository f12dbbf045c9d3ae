"""Where the middle of a dot lies in what it leaves of events.

A dot's flanks leave OFF events here and ON events there; light and direction of the roll decide
which. Spots of one kind, and a pattern of both, lie off the middle by up to the dot's radius. Light
from all around makes brightness across a dot even, so that its change along the roll, ON less OFF
events, is odd about the middle: there it fits its own mirror image with the sign changed.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from .reader_settings import Spacing
from .warp import F32, F64

#: Dots that count, the last ones.
_MOST_DOTS = 24
#: What is looked at along the roll on either side, and how far off the middle may lie, by the pitch
#: of dots: the flanks of the next dot are beyond.
_REACH, _OFF = 0.75, 0.35
#: Share of it that the mirror image must hold.
_ODD = 0.3


class DotCentre:
    """How far the middles of a line's dots lie from its lattice's nodes, along the roll.

    Parameters
    ----------
    spacing : Spacing
        Pitch and diameter of dots.
    px_m : float
        Pixel of the mosaic, metres.
    """

    def __init__(self, spacing: Spacing, px_m: float) -> None:
        self._px_m = px_m
        self._reach = round(_REACH * spacing.dot_pitch_m / px_m)
        self._most = round(2 * _OFF * spacing.dot_pitch_m / px_m)  # in half pixels
        self._half = round(spacing.dot_diameter_m / 4 / px_m)
        #: Columns and rows to cut out around nodes.
        self.margin = self._reach + 2
        self._profiles: deque[F64] = deque(maxlen=_MOST_DOTS)
        #: Metres further along the roll; 0 while it isn't known.
        self.off_m = 0.0

    def add(self, net: F32, at: F64) -> None:
        """Take dots.

        Parameters
        ----------
        net : ndarray of float32
            ON less OFF events.
        at : ndarray, shape (n, 2)
            Column and row in it of nodes with a dot.
        """
        columns = np.arange(net.shape[1]) + 0.5
        steps = np.arange(-self._reach, self._reach + 1)
        for column, row in at:
            first = max(int(row) - self._half, 0)
            profile = net[first : int(row) + self._half + 1].sum(axis=0, dtype=np.float64)
            self._profiles.append(np.interp(column + steps, columns, profile, 0.0, 0.0))
        if self._profiles:
            self._find(np.sum(self._profiles, axis=0))

    def _find(self, profile: F64) -> None:
        # Of place k the mirror about k / 2.
        held = -np.convolve(profile, profile)
        first = 2 * self._reach - self._most
        near = held[first : first + 2 * self._most + 1]
        k = int(np.argmax(near))
        if not 0 < k < len(near) - 1 or near[k] < _ODD * (profile @ profile):
            return
        a, b, c = near[k - 1 : k + 2]
        curve = a - 2 * b + c
        between = 0.5 * (a - c) / curve if curve < 0 else 0.0
        self.off_m = float(k + between - self._most) / 2 * self._px_m
