"""Settings of the Braille reader: defaults, ranges and descriptions in one place.

Node parameters, `config/braille.yaml` and the README's table come from here.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import lru_cache
from itertools import zip_longest
from typing import Annotated, Literal

from pydantic import Field

from roller_core.frame_settings import NominalSurface
from roller_core.timing_settings import TimingSettings

#: Poses on either side over which the stamps of poses are smoothed: each costs the time between two
#: poses, and what jitter is left moves a dot by some hundredths of a millimetre.
POSE_SMOOTHING = 1

Profile = Literal["auto", "nls", "marburg", "wide"]
_Length = Annotated[float, Field(ge=0.0, le=0.05)]


@dataclass(frozen=True)
class Spacing:
    """Distances on a Braille plate, metres."""

    dot_pitch_m: float
    cell_pitch_m: float
    line_pitch_m: float
    dot_diameter_m: float


#: Library of Congress (NLS specification 800), Marburg Medium, and the widest cells in use.
PROFILES: dict[str, Spacing] = {
    "nls": Spacing(2.34e-3, 6.2e-3, 10.0e-3, 1.44e-3),
    "marburg": Spacing(2.5e-3, 6.0e-3, 10.0e-3, 1.5e-3),
    "wide": Spacing(2.5e-3, 6.8e-3, 10.0e-3, 1.5e-3),
}


class BrailleSettings(TimingSettings, NominalSurface):
    """From events to text."""

    profile: Profile = Field(
        "auto",
        description="Spacing of the plate: nls (2.34 / 6.2 / 10 mm between dots / cells / lines), "
        "marburg (2.5 / 6.0 / 10 mm), wide (2.5 / 6.8 / 10 mm), or auto: whichever fits a line's "
        "first dots best.",
    )
    spacing_m: tuple[_Length, ...] = Field(
        (0.0,),
        max_length=4,
        description="Spacing of another plate: distances of dots in a cell, of cells and of lines, "
        "diameter of a dot's base, m; a 0, or what isn't given: the profile's.",
    )
    code: Literal["grade1", "ueb1", "ueb2"] = Field(
        "grade1",
        description="How cells are read as print: grade1 by our own table; ueb1 and ueb2 as "
        "Unified English Braille, uncontracted or contracted, by liblouis (python3-louis).",
    )
    depth_source: Literal["fixed", "surface"] = Field(
        "fixed",
        description="Depth of the surface: fixed (depth_m), or from the camera's height in base "
        "over the plane surface_z_m.",
    )
    depth_m: float = Field(
        0.0455, ge=0.001, le=10.0, description="Depth of the surface with source fixed, m."
    )
    view_half_width_m: float = Field(
        0.0125,
        ge=0.001,
        le=0.1,
        description="Events this far from the optical axis along the roll are used, m; the skin "
        "outside the contact does not move with the surface.",
    )
    read_at_m: float = Field(
        0.006,
        ge=0.0,
        le=0.1,
        description="Cells are read once they are this far behind the optical axis, m, or out of "
        "the view; nearer comes sooner, from fewer events.",
    )
    max_scale_error: float = Field(
        0.15,
        ge=0.0,
        le=0.3,
        description="Largest error of speed or depth, as a share, that is found from the events by "
        "contrast maximisation and put right; 0 is off.",
    )
    polarity: Literal["auto", "off", "on", "both"] = Field(
        "auto",
        description="Events that make up the image: both, as in the paper; off or on; or auto, "
        "line by line the kind that is better confined to dots.",
    )
    line_order: Literal["seen", "reading"] = Field(
        "seen",
        description="Of lines in view together, seen: cells of all come as they pass, told apart "
        "by line and column; reading: those of the lower one come after the upper one's last.",
    )

    @property
    def spacings(self) -> tuple[Spacing, ...]:
        """Spacings that a line may have: all profiles' with `auto`, unless one is set apart."""
        if self.profile == "auto" and not any(self.spacing_m):
            return tuple(PROFILES.values())
        return (self.spacing,)

    @property
    def spacing(self) -> Spacing:
        """The profile's spacing with what is set apart put in; with `auto` that of `nls`."""
        return _spacing("nls" if self.profile == "auto" else self.profile, self.spacing_m)


@lru_cache(maxsize=16)
def _spacing(profile: str, spacing_m: tuple[float, ...]) -> Spacing:
    known = astuple(PROFILES[profile])
    return Spacing(*(own or of for own, of in zip_longest(spacing_m, known)))
