"""A gauge of edge drift: lines over a surface whose heights are known, and what they err by.

Lines are fitted to the events of each pass without a correction. Two things a gauge doesn't say
stay unknown, each with a spread of its own: where the sphere's middle is along the roll, and how
high on a step's wall the events of a polarity arise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.methods.surface import SurfaceSettings

from .pass_lines import EdgeDriftError, PassLines, pass_lines
from .recordings import Scan

#: Lines of a gauge, at least, and on slopes.
LEAST_LINES = 100
#: Share that a gauge's size may be off by drift; from which on what was given is said beside it,
#: and steps are asked about.
OTHER_SIZE, _APART = 0.3, 0.05


def size_text(fitted_m: float, given_m: float, option: str, odd: bool | None = None) -> str:
    """Size of a gauge as found, with what was given where the two are apart.

    Parameters
    ----------
    fitted_m, given_m : float
        The two, metres.
    option : str
        Where it was given.
    odd : bool, optional
        Whether the given one can't be right; else it can't where they are apart.
    """
    off = fitted_m / given_m - 1
    apart = abs(off) > _APART
    odd = apart if odd is None else odd
    text = f"{fitted_m * 1e3:.3f} mm"
    if apart or odd:
        asked = f"; is {option} right?" if odd else ""
        text += f" ({off:+.0%} against the {given_m * 1e3:g} mm given{asked})"
    return text


class OffSizeError(EdgeDriftError):
    """A gauge whose size is further off the stated one than its lines or depths may be."""


class OtherGaugeError(OffSizeError):
    """A gauge whose size is so far off the stated one that drift doesn't explain it."""


@dataclass(frozen=True)
class Gauge:
    """Lines of a pass over a gauge, with their heights over what they should have."""

    #: Of the recording.
    name: str
    #: Height less the gauge's. Shape (n,).
    error_m: F64
    #: How the heights of the lines change with what is unknown of the gauge. Shape (n, k).
    unknown: F64
    #: Spread of that. Shape (k,).
    spread: F64
    #: The lines.
    lines: LinePoints
    #: Slope of the gauge along the roll at each line; of steps 1 or -1. Shape (n,).
    rise: F64
    #: Whether it is a sphere, on which the height of every place is known.
    sphere: bool
    #: What was found, for people.
    text: str
    #: See `PassLines`.
    travel: float


def of_lines_or_depths(
    scan: Scan, settings: SurfaceSettings, measure: Callable[[list[PassLines]], list[Gauge]]
) -> list[Gauge]:
    """What lines tell, or where those are too few, the depths of neighbourhoods.

    Raises
    ------
    EdgeDriftError
        If neither shows the gauge, or lines show one of another size.
    """
    reason = EdgeDriftError(
        f"{scan.name}: no edges in view; does it show the gauge, and is the depth range right?"
    )
    for passes in pass_lines(scan, settings):
        try:
            return measure(passes)
        except OffSizeError:
            raise
        except EdgeDriftError as own:
            reason = own
    raise reason


def take(lines: LinePoints, which: npt.NDArray[np.bool_]) -> LinePoints:
    """Some of the lines."""
    return replace(lines, **{n: getattr(lines, n)[which] for n in LinePoints.__dataclass_fields__})
