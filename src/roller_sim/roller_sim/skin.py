"""The elastomer's skin over a relief.

The skin touches flat tops, tents over walls and edges, and fills what it can reach. In two steps:
the upper envelope of the relief among surfaces no steeper than a limit (the pressure that closes a
wave of the relief grows with its slope, so the limit stands for pressure), then Gaussian smoothing
at falling widths, in between which the skin is put back up where it sank below the contact, as
tactile simulators do; the last pass leaves edges rounded.
"""

from __future__ import annotations

import math

import cv2
import numba
import numpy as np

from .cell_settings import SkinSettings
from .relief import F32, HeightMap

#: Widths of the smoothing passes after which contact is restored, in units of the last one.
_PYRAMID = (2.0, 1.0)
#: Width of the last one at full contact, mm.
_SMOOTHING_MM = 0.08
#: Steepest skin beside a wall, at full contact.
_MAX_SLOPE = 2.0
#: Share of the full press depth, and with it the reach of the skin.
CONTACT = {"light": 0.2, "medium": 0.55, "full": 1.0}


@numba.njit(cache=True, nogil=True)
def _envelope(height, slope_step):  # type: ignore[no-untyped-def]
    """Raise `height` (ny, nx) in place to its upper envelope of limited slope.

    `slope_step` is the largest difference between direct neighbours. A chamfer transform: two
    passes over a grid without obstacles find the exact maximum over all lattice paths.
    """
    ny, nx = height.shape
    d1 = np.float32(slope_step)
    d2 = np.float32(slope_step * math.sqrt(2.0))
    for i in range(ny):
        for j in range(nx):
            best = height[i, j]
            if i > 0:
                best = max(best, height[i - 1, j] - d1)
                if j > 0:
                    best = max(best, height[i - 1, j - 1] - d2)
                if j < nx - 1:
                    best = max(best, height[i - 1, j + 1] - d2)
            if j > 0:
                best = max(best, height[i, j - 1] - d1)
            height[i, j] = best
    for i in range(ny - 1, -1, -1):
        for j in range(nx - 1, -1, -1):
            best = height[i, j]
            if i < ny - 1:
                best = max(best, height[i + 1, j] - d1)
                if j > 0:
                    best = max(best, height[i + 1, j - 1] - d2)
                if j < nx - 1:
                    best = max(best, height[i + 1, j + 1] - d2)
            if j < nx - 1:
                best = max(best, height[i, j + 1] - d1)
            height[i, j] = best


def _blur(height: F32, sigma_px: float) -> F32:
    if sigma_px < 0.1:
        return height
    return np.asarray(
        cv2.GaussianBlur(height, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE), np.float32
    )


def press_depth_mm(settings: SkinSettings, full_mm: float) -> float:
    """How deep the roller is pressed below the plate's face, mm.

    Parameters
    ----------
    settings : SkinSettings
        `contact` and, if not 0, `press_mm`, which replaces `full_mm`.
    full_mm : float
        The scene's press depth at full contact.
    """
    return CONTACT[settings.contact] * (settings.press_mm or full_mm)


def skin_over(relief: HeightMap, settings: SkinSettings) -> HeightMap:
    """The skin's resting shape over a relief, where the roller presses it on.

    Parameters
    ----------
    relief : HeightMap
        The bare surface.
    settings : SkinSettings
        At less than full contact the slope limit falls and the smoothing grows with the root of
        the press depth, as the pressure under a roller does: short, shallow relief fades.

    Returns
    -------
    HeightMap
        On the same grid; no steeper than the limit along either axis.
    """
    pressure = math.sqrt(CONTACT[settings.contact])
    step_mm = relief.step * 1e3
    envelope = relief.height.copy()
    _envelope(envelope, _MAX_SLOPE * pressure * relief.step)
    sigma = _SMOOTHING_MM / pressure / step_mm
    skin = envelope
    for scale in _PYRAMID:
        skin = np.maximum(_blur(skin, scale * sigma), envelope)
    return HeightMap(_blur(skin, sigma), relief.x0, relief.y0, relief.step)
