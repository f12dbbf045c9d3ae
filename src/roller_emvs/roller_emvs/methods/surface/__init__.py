"""Heights from events voted into a strip fixed to the surface."""

from .surface_patch import SurfacePatch
from .surface_settings import SurfaceSettings
from .sweep import SurfaceSweep

__all__ = ["SurfacePatch", "SurfaceSettings", "SurfaceSweep"]
