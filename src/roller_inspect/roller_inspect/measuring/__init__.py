"""Measuring tools on a height map: each gives a value with its uncertainty and unit."""

from .datum import Datum, datum_plane
from .measured import Measured
from .profile import Profile, profile, width_and_depth
from .roughness import Roughness, roughness
from .steps import Fastener, fastener, step_height
from .surfaces import Extent, extent

__all__ = [
    "Datum",
    "Extent",
    "Fastener",
    "Measured",
    "Profile",
    "Roughness",
    "datum_plane",
    "extent",
    "fastener",
    "profile",
    "roughness",
    "step_height",
    "width_and_depth",
]
