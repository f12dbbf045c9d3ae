"""Points of the surface that are done, as stitcher and surface sweep hand them out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.outputs import SURFACE_POINTS, Cloud, Output
from roller_core.transforms import F64

#: What is known of a point beside its place.
SURFACE_PROPERTIES = ("height", "confidence", "sigma")
SURFACE_FIELDS = ("x", "y", "z", *SURFACE_PROPERTIES)


@dataclass(frozen=True)
class Patch:
    """Points of the surface that are done."""

    #: Metres, frame base. Shape (n, 3).
    points: F64
    #: Above the nominal surface, metres. Shape (n,).
    height: npt.NDArray[np.float32]
    #: 0–1. Shape (n,).
    confidence: npt.NDArray[np.float32]
    #: Standard uncertainty of the height, metres. Shape (n,).
    sigma: npt.NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)

    def columns(self) -> npt.NDArray[np.float32]:
        """x, y, z, height, confidence, sigma as float32, shape (n, 6)."""
        return np.column_stack([self.points, *self.properties()]).astype(np.float32)

    def properties(self) -> tuple[npt.NDArray[np.float32], ...]:
        """Height, confidence and sigma, as a file of points takes them."""
        return self.height, self.confidence, self.sigma


def patch_output(patch: Patch, t_ns: int, frame_id: str) -> Output:
    """What goes out of a patch; a point is in one patch only, so the clouds add up."""
    return Output(SURFACE_POINTS, t_ns, frame_id, Cloud(patch.columns(), SURFACE_FIELDS))
