"""Scale at the sensor's surface from caliper readings, as the paper takes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roller_core.errors import RollerError

#: Scale of the paper's sensor, mm/px, and its number of readings.
PAPER_MM_PER_PX, PAPER_READINGS = 0.0422, 8
#: Share by which a scale may differ from the camera's own.
_MOST_OFF = 0.05
#: A reading may differ by this share from the median of the others.
MOST_OFF = 0.1


class ScaleError(RollerError):
    """Readings that make no scale, or a scale that makes no sense."""


@dataclass(frozen=True)
class Scale:
    """Mean scale of readings."""

    #: Mean of the readings' scales.
    mm_per_px: float
    #: Their standard deviation.
    deviation_mm_per_px: float
    #: Largest less smallest, as a share of the mean.
    spread: float
    #: Number of readings.
    readings: int

    @property
    def standard_error_mm_per_px(self) -> float:
        """Standard error of the mean."""
        return self.deviation_mm_per_px / float(np.sqrt(self.readings))


def scale_of(readings_mm: Sequence[float], pixels: Sequence[float]) -> Scale:
    """Scale from distances set on a caliper and what the image shows of them.

    Parameters
    ----------
    readings_mm : sequence of float
        Openings of the caliper.
    pixels : sequence of float
        The same in the image, px.

    Raises
    ------
    ScaleError
        Naming the reading that makes no sense.
    """
    if len(readings_mm) != len(pixels):
        raise ScaleError(f"{len(readings_mm)} readings in mm and {len(pixels)} in pixels")
    if len(readings_mm) < 2:
        raise ScaleError(
            f"{len(readings_mm)} reading; the paper takes {PAPER_READINGS}, 2 at least"
        )
    mm, px = np.asarray(readings_mm, np.float64), np.asarray(pixels, np.float64)
    bad = np.flatnonzero(~(np.isfinite(mm) & np.isfinite(px) & (mm > 0) & (px > 0)))
    if len(bad):
        k = int(bad[0])
        raise ScaleError(f"reading {k + 1} ({mm[k]:g} mm, {px[k]:g} px) isn't positive")
    each = mm / px
    # Against the others, not against a median that it is part of.
    others = np.array([np.median(np.delete(each, k)) for k in range(len(each))])
    off = np.abs(each / others - 1)
    worst = int(np.argmax(off))
    if off[worst] > MOST_OFF:
        raise ScaleError(
            f"reading {worst + 1} ({mm[worst]:g} mm, {px[worst]:g} px: {each[worst]:.4g} mm/px) is "
            f"{off[worst]:.0%} off the others ({others[worst]:.4g} mm/px), more than "
            f"{MOST_OFF:.0%}: read it again"
        )
    mean = float(each.mean())
    return Scale(mean, float(each.std(ddof=1)), float(np.ptp(each)) / mean, len(each))


def check_scale(given_mm_per_px: float, depth_m: float, focal_px: float) -> float:
    """How far a measured scale is off the camera's own at a depth, as a share.

    Parameters
    ----------
    given_mm_per_px : float
        Scale by caliper.
    depth_m : float
        Depth of the surface, metres.
    focal_px : float
        Focal length, px.

    Raises
    ------
    ScaleError
        If it is more than `_MOST_OFF`, or the scale isn't positive.
    """
    if not given_mm_per_px > 0:
        raise ScaleError(f"a scale of {given_mm_per_px:g} mm/px isn't positive")
    own = depth_m * 1e3 / focal_px
    off = given_mm_per_px / own - 1
    if abs(off) > _MOST_OFF:
        raise ScaleError(
            f"the scale {given_mm_per_px:g} mm/px is {off:+.1%} off the camera's calibration "
            f"({own:.4f} mm/px at {depth_m * 1e3:.2f} mm), more than {_MOST_OFF:.0%}: one is wrong"
        )
    return off
