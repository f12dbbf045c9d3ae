"""Which events an image is made of."""

from __future__ import annotations

from enum import Enum


class Kind(Enum):
    """Which events an image is made of."""

    OFF = "off"
    ON = "on"
    BOTH = "both"
