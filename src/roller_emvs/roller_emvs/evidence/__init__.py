"""Where warped events are sharpest: the evidence that `focus` and `surface` share."""

from ._kernels import CELL_PX
from .evidence_settings import EvidenceSettings
from .field import RayField
from .relief import Relief, measured_pixels
from .sweep import Depths, find_depths

__all__ = [
    "CELL_PX",
    "Depths",
    "EvidenceSettings",
    "RayField",
    "Relief",
    "find_depths",
    "measured_pixels",
]
