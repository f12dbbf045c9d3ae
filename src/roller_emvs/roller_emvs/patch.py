"""Points of the surface that are done, as stitcher and surface sweep hand them out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64


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
