"""Whether light travels with the camera: only then do edges drift."""

from __future__ import annotations

import numpy as np

from roller_core.transforms import F64

#: Change of the events' density up to which light stands still, and from which it travels. Tuned on
#: the virtual cell: 0.2-1 under a dome, 1.3-7 under its ring.
_STILL, _TRAVELS = 1.0, 1.6


def share_of_travel(change: float) -> float:
    """0 where light stands still, 1 where it travels with the camera.

    Parameters
    ----------
    change : float
        Of the events' density along a crossing: (mean of the rays' slopes less the middle of the
        aperture) / their variance.
    """
    return float(np.clip((change - _STILL) / (_TRAVELS - _STILL), 0.0, 1.0))


class TravellingLight:
    """Whether light travels with the camera, from how the events of lines lie over their rays.

    Where contrast changes along a crossing, so does the number of events; in light that stands
    still by no more than chance. See `share_of_travel`.
    """

    #: Weight of the lines from which on they say something.
    _ENOUGH = 100.0

    def __init__(self) -> None:
        self._square = self._weight = 0.0

    def add(self, lean: F64, spread: F64, events: F64) -> None:
        """Take lines, shape (n,): lean of the rays' slopes, their variance, independent events."""
        chance = 1.0 / (events * spread)
        self._square += float((((lean / spread) ** 2 - chance) / chance).sum())
        self._weight += float((1.0 / chance).sum())

    @property
    def share(self) -> float:
        """0 where light stands still, 1 where it travels or where that isn't known."""
        if self._weight < self._ENOUGH:
            return 1.0
        change = np.sqrt(max(self._square / self._weight, 0.0))
        return share_of_travel(change)
