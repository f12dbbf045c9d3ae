"""Points of the surface that are done, as stitcher and surface sweep hand them out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.outputs import SURFACE_POINTS, Cloud, Output
from roller_core.transforms import F64

SURFACE_FIELDS = ("x", "y", "z", "height", "confidence")


@dataclass(frozen=True)
class Patch:
    """Points of the surface that are done.

    Attributes
    ----------
    points : ndarray of float64, shape (n, 3)
        Metres, frame base.
    height : ndarray of float32, shape (n,)
        Above the nominal surface, metres.
    confidence : ndarray of float32, shape (n,)
        0–1.
    """

    points: F64
    height: npt.NDArray[np.float32]
    confidence: npt.NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)

    def columns(self) -> npt.NDArray[np.float32]:
        """x, y, z, height, confidence as float32, shape (n, 5)."""
        return np.column_stack([self.points, self.height, self.confidence]).astype(np.float32)


def patch_output(patch: Patch, t_ns: int, frame_id: str) -> Output:
    """What goes out of a patch; a point is in one patch only, so the clouds add up.

    Parameters
    ----------
    patch : Patch
        The points.
    t_ns : int
        Stamp, ROS time.
    frame_id : str
        Frame of the points.
    """
    return Output(SURFACE_POINTS, t_ns, frame_id, Cloud(patch.columns(), SURFACE_FIELDS))
