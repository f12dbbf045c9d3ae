"""Where warped events are sharpest: the evidence that `focus` and `surface` share."""

from ._kernels import CELL_PX
from .coarse import coarse_planes, measure_of_spots, offset_of_parts
from .evidence_settings import EvidenceSettings
from .field import EvidenceField, RayField
from .focus_measure import plane_offsets
from .part_images import PartImages, Parts
from .relief import Relief, is_textured, measured_pixels
from .sweep import Depths, find_depths, planes_near, sharpest
from .wider import follow_wider

__all__ = [
    "CELL_PX",
    "Depths",
    "EvidenceField",
    "EvidenceSettings",
    "PartImages",
    "Parts",
    "RayField",
    "Relief",
    "coarse_planes",
    "find_depths",
    "follow_wider",
    "is_textured",
    "measure_of_spots",
    "measured_pixels",
    "offset_of_parts",
    "plane_offsets",
    "planes_near",
    "sharpest",
]
