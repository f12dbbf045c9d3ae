"""The height map: cells that were measured, cells that go on from them, and the rest."""

from .height_map import CONTINUED, MEASURED, OUTSIDE, UNMEASURED, HeightMap, HeightMapError

__all__ = ["CONTINUED", "MEASURED", "OUTSIDE", "UNMEASURED", "HeightMap", "HeightMapError"]
