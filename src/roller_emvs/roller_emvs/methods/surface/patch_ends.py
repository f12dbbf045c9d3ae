"""Where along the roll the skin lies on the surface: its ends lift off, and move apart from it.

A soft roller touches what it rolls over along a patch. Where the image reaches beyond, the skin is
still bright, and what is printed on it moves otherwise than the surface does. A few columns that
err by half a pixel at either end, where the baseline is longest, put all of a surface too high or
too low. Under a texture they show: their events lie beside the lines that all others agree on.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core import numba_start  # noqa: F401 (before a kernel runs)
from roller_core.transforms import F64
from roller_emvs.evidence.field import ground
from roller_emvs.lines.fit import ROW_STEP
from roller_emvs.lines.refine import LinePoints
from roller_emvs.rays import F32

#: Columns of the image that are looked at as one, px.
_COLUMNS_PX = 4.0
#: An event within this of a line is of it, and pixels to either side of one that are its own, px.
_MOST_PX, _BESIDE = 1.5, 1
#: Events from which on columns tell where they lie, and those of one end from which on it is known.
_ENOUGH, _ENOUGH_AT_END = 400, 8000
#: Part of the aperture that is an end, and the part at most that may be off the surface.
_END, _MOST_OFF = 0.1, 0.2
#: Part of the aperture that says how events lie where the skin is on the surface.
_INNER = 0.6
#: Columns whose events lie further than this beside the lines are off it, and the outermost ones
#: further than this if any are, px.
_APART_PX, _SURELY_PX = 0.06, 0.1


class PatchEnds:
    """Finds the ends of the contact patch from events of a texture and the lines through them.

    Parameters
    ----------
    slopes : tuple of float
        Least and most slope dx/dz of the rays.
    focal_px : float
        Focal length, px.
    """

    def __init__(self, slopes: tuple[float, float], focal_px: float) -> None:
        self._low, self._high = slopes
        count = max(round((self._high - self._low) * focal_px / _COLUMNS_PX), 1)
        self._sums, self._counts = np.zeros(count), np.zeros(count, np.int64)
        #: Slopes between which the skin is on the surface, infinite while an end isn't known.
        self.ends = (-np.inf, np.inf)
        self._known = [False, False]

    @property
    def known(self) -> bool:
        """Whether both ends were looked at."""
        return all(self._known)

    def look(
        self, rays: tuple[F32, F32], surfaces: tuple[F32, ...], lines: LinePoints, scale: float
    ) -> bool:
        """Take events and lines of a block; whether the ends are nearer than they were.

        Parameters
        ----------
        rays : tuple of ndarray of float32, shape (n, 4)
            OFF and ON events; see `fit_lines`.
        surfaces : tuple of ndarray of float32, shape (height, width)
            Offset by pixel where each has a depth, NaN elsewhere.
        lines : LinePoints
            Fitted to them.
        scale : float
            From the rays' slopes to dx/dz.
        """
        for polarity, own in enumerate(rays):
            which = lines.polarity == polarity
            if not which.any():
                continue
            near = _near(lines.row[which], lines.column[which], surfaces[polarity].shape)
            pixel, _ = ground(own, surfaces[polarity])
            _add_beside(
                own, pixel, near, lines.column[which], lines.offset[which], _MOST_PX,
                self._low / scale, len(self._sums) * scale / (self._high - self._low),
                self._sums, self._counts,
            )  # fmt: skip
        before = self.ends
        self._find()
        return self.ends != before

    def _find(self) -> None:
        """The ends, as far as enough events tell."""
        count = len(self._sums)
        enough = self._counts >= _ENOUGH
        middle = 2 * np.abs((np.arange(count) + 0.5) / count - 0.5)
        inner = enough & (middle < _INNER)
        if inner.sum() < 3:
            return
        place = np.arange(count, dtype=np.float64)
        apart = self._sums / np.maximum(self._counts, 1)
        # Lines follow the ends a little: what grows evenly along the aperture is a depth.
        apart = apart - np.polyval(np.polyfit(place[inner], apart[inner], 1), place)
        if np.sqrt(np.mean(apart[inner] ** 2)) > _SURELY_PX:
            return  # what is not even in the middle tells nothing of the ends
        width = (self._high - self._low) / count
        size = max(round(_END * count), 1)
        low, high = self.ends
        if not self._known[0] and self._counts[:size].sum() >= _ENOUGH_AT_END:
            off, self._known[0] = _off(apart, enough), True
            low = self._low + off * width if off else low
        if not self._known[1] and self._counts[-size:].sum() >= _ENOUGH_AT_END:
            off, self._known[1] = _off(apart[::-1], enough[::-1]), True
            high = self._high - off * width if off else high
        self.ends = (low, high)


def _off(apart: F64, enough: np.ndarray) -> int:
    """How many of the first columns lie off the surface; 0 if it is too many to be an end."""
    told = np.flatnonzero(enough)
    away = np.abs(apart[told])
    # Two that lie on it in a row, as one may by chance, and the one before them to be sure.
    on = np.flatnonzero(np.maximum(away[:-1], away[1:]) <= _APART_PX)
    if not len(on) or on[0] == 0 or away[0] <= _SURELY_PX:
        return 0
    off = int(told[on[0]]) + 1
    return off if off <= _MOST_OFF * len(apart) else 0


def _near(row: F64, column: F64, shape: tuple[int, ...]) -> np.ndarray:
    """The line that each pixel is next to, -1 for none; int32, flat, one entry more: nowhere."""
    near = np.full((shape[0] + ROW_STEP, shape[1]), -1, np.int32)
    x = np.rint(column).astype(np.int64)
    number = np.arange(len(x), dtype=np.int32)
    for step in range(-_BESIDE, _BESIDE + 1):
        inside = (x + step >= 0) & (x + step < shape[1])
        for down in range(ROW_STEP):
            near[row[inside].astype(np.int64) + down, x[inside] + step] = number[inside]
    return np.append(near[: shape[0]].reshape(-1), np.int32(-1))


@njit(cache=True, nogil=True)
def _add_beside(rays, pixel, near, column, offset, most, low, per_bin, sums, counts):  # type: ignore[no-untyped-def]
    """Add how far events lie beside the lines they are next to, by slope of their rays."""
    for i in range(len(rays)):
        k = near[pixel[i]]
        if k < 0:
            continue
        slope = rays[i, 2]
        apart = rays[i, 0] + slope * offset[k] - column[k]
        bin_ = int(np.floor((slope - low) * per_bin))
        if abs(apart) <= most and 0 <= bin_ < len(sums):
            sums[bin_] += apart
            counts[bin_] += 1
