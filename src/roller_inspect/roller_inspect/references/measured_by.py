"""By what the map of a scan was measured: those of a golden reference must be alike."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from roller_core.plain_json import plain

from .reference import ReferenceError

#: Parts of a replay's settings that a surface hangs on.
_SWEEP, _MAPS = ("surface",), ("emvs", "stitcher")
#: Settings that change no heights: of the machine, of the graph, and of the map to look at.
_NO_MATTER = re.compile(
    r"threads|max_waiting_mb|max_latency_s|idle_flush_s|max_still_s|\w+_frame|map|calibrated_camera"
)


@dataclass(frozen=True)
class MeasuredBy:
    """By what a map was measured; what isn't known is empty."""

    method: str = ""
    camera: str = ""
    grid_m: float = 0.0
    #: Of the stages that the surface is from, by their names in reports.
    settings: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, method: str, settings: Mapping[str, Any], camera: str, grid_m: float) -> MeasuredBy:
        """Of a replay's method and settings; `camera`: in words."""
        stages = _SWEEP if method == "surface" else _MAPS
        flat = {
            f"{stage}.{name}": value
            for stage in stages
            for name, value in plain(settings.get(stage, {})).items()
            if not _NO_MATTER.fullmatch(name)
        }
        return cls(method, camera, grid_m, flat)

    def differs(self, other: MeasuredBy) -> str:
        """In what it differs from another, in words; empty: in nothing that is known of both."""
        for name in ("method", "camera", "grid_m"):
            own, theirs = getattr(self, name), getattr(other, name)
            if own and theirs and own != theirs:
                return f"{name} {own}, not {theirs}"
        names = [
            n for n, v in self.settings.items() if n in other.settings and v != other.settings[n]
        ]
        return f"other settings ({', '.join(names)})" if names else ""


def check_alike(made: Mapping[str, MeasuredBy]) -> None:
    """Refuse maps that were measured differently.

    Parameters
    ----------
    made : mapping
        By what to call the scans, or the options that they are held to.

    Raises
    ------
    ReferenceError
        Naming two, and in what they differ.
    """
    (first, one), *others = made.items()
    for name, other in others:
        if why := other.differs(one):
            raise ReferenceError(
                f"{name} was measured otherwise than {first}: {why}; a reference is of scans that "
                "were measured alike: give recordings, or inspect them anew"
            )
