"""Points of the surface as they come from the graph, and which of them can be of the part."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.errors import RollerError
from roller_core.outputs import SURFACE_POINTS, Cloud
from roller_core.transforms import F64
from roller_emvs.patch import SURFACE_FIELDS, Patch

#: No surface is further than this from base, m.
_FARTHEST_M = 1e4
#: A cloud's points lie this near to its middle, and that to where the part was seen so far, m: the
#: map has memory for what is between.
_CLOUD_M, _PART_M = 0.5, 1.0
#: From so many of a cloud's points, or twice as many, its middle is told.
_SOME = 4000


class PointsError(RollerError):
    """A cloud that isn't one of points of the surface, or not of the part."""


class PartPoints:
    """Lets those points pass that can be of the part which the first ones are of.

    Attributes
    ----------
    left_out : int
        Points that are not finite, or far from the others.
    """

    def __init__(self) -> None:
        self.left_out = 0
        self._box: tuple[F64, F64] | None = None

    def begin(self) -> None:
        """Another part follows."""
        self._box = None

    def take(self, cloud: Cloud) -> Patch:
        """The points of a cloud that can be of the part.

        Raises
        ------
        PointsError
            If they aren't points of ours, or all are far from the part.
        """
        if cloud.names != SURFACE_FIELDS:
            raise PointsError(
                f"{SURFACE_POINTS}: fields {', '.join(cloud.names)}; expected "
                f"{', '.join(SURFACE_FIELDS)}"
            )
        # By axis: the rows are short, and each would cost a loop of its own.
        columns = np.ascontiguousarray(cloud.columns.T)
        columns = _near(columns, np.zeros(3), _FARTHEST_M)
        if columns.size:
            # Which is far from all others some of them tell.
            some = columns[:3, :: 1 + columns.shape[1] // _SOME].astype(np.float64)
            middle = np.median(some, axis=1)
            low, high = self._box or (middle, middle)
            if ((middle < low - _PART_M) | (middle > high + _PART_M)).any():
                self.left_out += len(cloud.columns)
                raise PointsError(
                    f"{SURFACE_POINTS}: points around {np.round(middle, 3).tolist()} m are far "
                    "from the part's others and left out; service ~/start begins another part"
                )
            columns = _near(columns, middle, _CLOUD_M)
            if columns.size:
                ends = columns[:3].min(axis=1), columns[:3].max(axis=1)
                self._box = np.minimum(low, ends[0]), np.maximum(high, ends[1])
        self.left_out += len(cloud.columns) - columns.shape[1]
        return Patch(np.ascontiguousarray(columns[:3].T, np.float64), *columns[3:])


def _near(columns: npt.NDArray[np.float32], middle: F64, reach_m: float) -> npt.NDArray[np.float32]:
    """Points of columns, shape (n, m), near to a place by axis; mostly they are all."""
    which = np.all(np.abs(columns[:3] - middle[:, None]) < reach_m, axis=0)
    return columns if which.all() else columns.compress(which, axis=1)
