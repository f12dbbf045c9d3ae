"""Points of the surface as they come from the graph, and which of them can be of the part."""

from __future__ import annotations

import numpy as np

from roller_core.errors import RollerError
from roller_core.outputs import SURFACE_POINTS, Cloud
from roller_core.transforms import F64
from roller_emvs.patch import SURFACE_FIELDS, Patch

#: No surface is further than this from base, m.
_FARTHEST_M = 1e4
#: A cloud's points lie this near to its middle, and that to where the part was seen so far, m: the
#: map has memory for what is between.
_CLOUD_M, _PART_M = 0.5, 1.0


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
        axes = np.array(cloud.columns[:, :3].T, np.float64, order="C")
        near = (np.abs(axes) < _FARTHEST_M).all(axis=0)
        if near.any():
            middle = np.median(axes[:, near], axis=1)
            near &= (np.abs(axes - middle[:, None]) < _CLOUD_M).all(axis=0)
            low, high = self._box or (middle, middle)
            if ((middle < low - _PART_M) | (middle > high + _PART_M)).any():
                self.left_out += near.size
                raise PointsError(
                    f"{SURFACE_POINTS}: points around {np.round(middle, 3).tolist()} m are far "
                    "from the part's others and left out; service ~/start begins another part"
                )
            kept = axes[:, near]
            if kept.size:
                self._box = np.minimum(low, kept.min(axis=1)), np.maximum(high, kept.max(axis=1))
        self.left_out += int(near.size - near.sum())
        return Patch(np.ascontiguousarray(axes[:, near].T), *cloud.columns[near, 3:].T)
