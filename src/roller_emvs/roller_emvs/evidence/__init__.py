"""Where warped events are sharpest: the evidence that `focus` and `surface` share."""

from .field import RayField
from .relief import Relief, measured_pixels
from .settings import EvidenceSettings
from .sweep import Depths, find_depths

__all__ = [
    "Depths",
    "EvidenceSettings",
    "RayField",
    "Relief",
    "find_depths",
    "measured_pixels",
]
